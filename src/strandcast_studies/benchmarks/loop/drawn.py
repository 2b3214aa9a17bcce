"""The loop on random strings, targets and servos; none was used for tuning.

    python -m strandcast_studies.benchmarks.loop.drawn --seeds 3001-3060 --out results/bench-drawn.json
    python -m strandcast_studies.benchmarks.loop.drawn --wide --seeds 6001-6060 --out results/bench-wide.json

As `loop.run`, but every seed has its own string, target and servo; with ``--wide`` also strings from 1 to
40 g/m, thin and thick, and rigs that repeat better or worse than the typical one, with or without heavy
tails; with ``--curled`` every string is light, thick and strongly curled. The first motion is played with an
empty clamp, and planned again, before it is thrown, but not with ``--unrehearsed``; with ``--filmed`` throws
are filmed and tracked in their videos; with ``--arm`` another arm throws, in its workspace; with
``--tool-speed`` the tool is slow. The planner knows only a string's length and the places of its weights.
"""

import json
import math
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.arm.load import load_arm
from strandcast.lab.variation import drawn_scatter
from strandcast_studies.benchmarks.loop.run import (
    PROJECT,
    RIGS,
    outcome,
    prepare,
    root_with_arms,
    run_jobs,
    run_parser,
    run_prepared,
)
from strandcast_studies.paper.cases import FILE, load_plan, merged

REPORTED_SEEDS = range(3001, 3061)
# Ranges, chosen to include the paper's strings.
LENGTH_M = (0.20, 0.65)
WEIGHTS, WEIGHT_KG = 2, (0.003, 0.020)  # largest number, and mass
FIRST_PLACE_M, APART_M = 0.06, 0.05  # least distance of weights from the hand, and from each other
# From sewing thread to thin rope; logarithmic, except for the curl.
DENSITY_KG_M, STIFFNESS_N_M2, DIAMETER_M = (0.002, 0.020), (3e-7, 1e-5), (0.002, 0.005)
CURL_RAD_M = 4.0
SERVOS = ("servoj", "stiff", "pd", "soft")
# With --wide: strings by their density, the density of their material, and the length over which their own
# weight bends them.
WIDE_DENSITY_KG_M, MATERIAL_KG_M3, BENDING_LENGTH_M = (0.001, 0.040), (100.0, 1300.0), (0.012, 0.06)
WIDE_WEIGHTS, WIDE_WEIGHT_KG, THICKEST_M = 3, (0.002, 0.030), 0.012
# With --curled: light, thick and strongly curled strings, which the model describes worst.
CURLED_DENSITY_KG_M, CURLED_MATERIAL_KG_M3, STRONG_CURL_RAD_M = (0.002, 0.006), (100.0, 300.0), (4.0, 10.0)
# A target is out of the arm's reach by up to this share of the string's length.
ARM_M, OF_LENGTH = 0.70, 0.6
EDGE_M = 0.10  # from the workspace's edge
POSTURES = 4000  # from which the reach of another arm is found


def wide_settings_of(common: dict[str, Any], seed: int) -> dict[str, Any]:
    """Return an experiment's settings with a string and a rig from the wide ranges."""
    random = np.random.default_rng([seed, 6])
    string = string_of(WIDE_DENSITY_KG_M, MATERIAL_KG_M3, random)
    usual = settings_of(common, seed)
    weights = drawn_weights(usual["string"]["length_m"], random, WIDE_WEIGHTS, WIDE_WEIGHT_KG)
    scatter = drawn_scatter(random)
    return merged(
        usual,
        {
            "string": {"weights": weights},
            "lab": {
                "string": string,
                "noise": dict(scatter.sizes),
                "draws": "heavy_tails" if scatter.heavy_tails else "normal",
            },
        },
    )


def curled_settings_of(common: dict[str, Any], seed: int) -> dict[str, Any]:
    """Return an experiment's settings with a string that is light, thick and strongly curled."""
    random = np.random.default_rng([seed, 7])
    string = string_of(CURLED_DENSITY_KG_M, CURLED_MATERIAL_KG_M3, random)
    curl = random.choice([-1.0, 1.0]) * random.uniform(*STRONG_CURL_RAD_M)
    return merged(settings_of(common, seed), {"lab": {"string": string | {"curl_rad_m": float(curl)}}})


def string_of(
    density_kg_m: tuple[float, float], material_kg_m3: tuple[float, float], random: np.random.Generator
) -> dict[str, float]:
    """Return a bare string that its own weight bends as much as cords and ropes."""
    density = log_uniform(density_kg_m, random)
    diameter_m = math.sqrt(4.0 * density / (math.pi * log_uniform(material_kg_m3, random)))
    bending_n_m2 = 9.81 * density * log_uniform(BENDING_LENGTH_M, random) ** 3
    return {
        "linear_density_kg_m": density,
        "bending_stiffness_n_m2": bending_n_m2,
        "diameter_m": min(diameter_m, THICKEST_M),
    }


def settings_of(common: dict[str, Any], seed: int) -> dict[str, Any]:
    """Return an experiment's settings: the `common` ones of config/paper.yaml and the random ones."""
    random = np.random.default_rng([seed, 5])
    length_m = round(float(random.uniform(*LENGTH_M)), 2)
    return merged(
        common,
        {
            "seed": seed,
            "string": {"length_m": length_m, "weights": drawn_weights(length_m, random, WEIGHTS, WEIGHT_KG)},
            "target_m": _target(common["workspace_m"], ARM_M, OF_LENGTH * length_m, random),
            "lab": {
                "string": {
                    "linear_density_kg_m": log_uniform(DENSITY_KG_M, random),
                    "bending_stiffness_n_m2": log_uniform(STIFFNESS_N_M2, random),
                    "diameter_m": log_uniform(DIAMETER_M, random),
                    "curl_rad_m": float(random.uniform(-CURL_RAD_M, CURL_RAD_M)),
                },
                "servo": SERVOS[random.integers(len(SERVOS))],
            },
        },
    )


def thrown_by(settings: dict[str, Any], name: str, seed: int) -> dict[str, Any]:
    """Return the settings with another arm, its workspace, and a target drawn by the same rule."""
    arm, random = load_arm(PROJECT / "config" / "arms" / f"{name}.toml"), np.random.default_rng([seed, 9])
    limits = arm.limits
    q = random.uniform(limits.lower_rad, limits.upper_rad, (POSTURES, len(arm.joints)))
    turned = np.array(q)
    turned[:, 0] += np.pi  # about the first joint: halfway between two such places it stands
    hand_m = arm.hand_m(q)
    shoulder_m = (hand_m + arm.hand_m(turned)).mean(axis=0) / 2.0
    far_m = float(np.linalg.norm(hand_m - shoulder_m, axis=1).max())
    box = dict(zip(("x_m", "y_m"), arm.box_m.tolist(), strict=True))
    target_m = _target(box, far_m, OF_LENGTH * settings["string"]["length_m"], random, shoulder_m)
    return merged(settings, {"arm": name, "workspace_m": box, "target_m": target_m})


def drawn_weights(
    length_m: float, random: np.random.Generator, most: int, mass_kg: tuple[float, float]
) -> list[dict[str, float]]:
    """Return up to `most` weights; only the lab knows their masses."""
    places_m = np.sort(random.uniform(FIRST_PLACE_M, length_m, random.integers(most + 1)))
    apart = np.diff(places_m, prepend=0.0) >= APART_M
    return [
        {"place_m": round(float(place_m), 2), "mass_kg": log_uniform(mass_kg, random)}
        for place_m in places_m[apart]
    ]


def _target(
    workspace_m: dict[str, list[float]],
    arm_m: float,
    beyond_m: float,
    random: np.random.Generator,
    shoulder_m: Sequence[float] = (0.0, 0.0),
) -> list[float]:
    """Return a place in the workspace that the string can reach but not the hand."""
    while True:
        x_m, y_m = (
            random.uniform(workspace_m[axis][0] + EDGE_M, workspace_m[axis][1] - EDGE_M)
            for axis in ("x_m", "y_m")
        )
        if arm_m < math.hypot(x_m - shoulder_m[0], y_m - shoulder_m[1]) < arm_m + beyond_m:
            return [round(float(x_m), 3), round(float(y_m), 3)]


def log_uniform(between: tuple[float, float], random: np.random.Generator) -> float:
    """Return a number that is uniform in its logarithm."""
    return float(np.exp(random.uniform(*np.log(between))))


DRAWS = {"drawn": settings_of, "wide": wide_settings_of, "curled": curled_settings_of}


def _job(
    root: str, seed: int, trials: int, draw: str, arm: str, rehearsed: bool, filmed: bool
) -> dict[str, Any]:
    settings = DRAWS[draw](load_plan(PROJECT / FILE).common, seed)
    if arm != settings["arm"]:
        settings = thrown_by(settings, arm, seed)
    settings = merged(settings, {"lab": {"rehearsal": rehearsed}})
    name = f"{draw}-{seed}"
    prepare(Path(root), name, settings)
    drawn = {key: settings[key] for key in ("seed", "string", "target_m", "lab")}
    thrown = outcome(lambda: run_prepared(Path(root), name, trials, RIGS["usual"], filmed=filmed))
    run = {"name": name} | drawn | thrown
    (Path(root) / "runs").mkdir(exist_ok=True)
    (Path(root) / "runs" / f"{name}.json").write_text(json.dumps(run, indent=1), encoding="utf-8")
    return run


def main(arguments: list[str] | None = None) -> None:
    """Run the experiments, two at a time; write each result as soon as it is known."""
    parser = run_parser(__doc__, list(REPORTED_SEEDS), "results/bench-drawn.json", strings=False)
    draw = parser.add_mutually_exclusive_group()
    for other, text in (("wide", "wide ranges, and rigs too"), ("curled", "light, thick, curled strings")):
        draw.add_argument(
            f"--{other}", dest="draw", action="store_const", const=other, default="drawn", help=f"draw {text}"
        )
    parser.add_argument("--unrehearsed", action="store_true", help="throw without a rehearsal")
    parser.add_argument("--filmed", action="store_true", help="film and track every throw, a minute of CPU")
    parser.add_argument("--work", type=Path, default=None, help="keep the experiments' folders here")
    parser.add_argument("--arm", default="planar3", help="a name in config/arms")
    parser.add_argument(
        "--tool-speed", type=float, metavar="M_S", help="limit flange and clamp to this speed"
    )
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="strandcast-drawn-") as folder:
        root = str(root_with_arms(options.work or Path(folder)))
        if options.tool_speed is not None:
            _limit_tools(Path(root), options.tool_speed)
        how = options.trials, options.draw, options.arm, not options.unrehearsed, options.filmed
        jobs = [(root, seed, *how) for seed in options.seeds]
        print(json.dumps(run_jobs(_job, jobs, options.jobs, options.out), indent=1))


def _limit_tools(root: Path, speed_m_s: float) -> None:
    """Limit the speed of flange and clamp of every arm."""
    for file in (root / "config" / "arms").glob("*.toml"):
        text = re.sub(r"(?m)^tool_speed_m_s.*\n", "", file.read_text(encoding="utf-8"))
        file.write_text(text.replace("[limits]", f"[limits]\ntool_speed_m_s = {speed_m_s}"), encoding="utf-8")


if __name__ == "__main__":
    main()
