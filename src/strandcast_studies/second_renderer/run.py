"""Film throws by the second renderer, run the commands on them, and compare stated errors with true ones.

    python -m strandcast_studies.second_renderer.run [--rigs NAME …] [--throws N] [--root DIR]

Each throw is an experiment of its own: photos, film and joint log are what a lab would have, and the commands
are those of a person. A target is put near the tip's true path, so that no motion need be planned. Prints a
row for each throw; docs/explanation/sure-misses.md says what is measured.
"""

import argparse
import csv
import json
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from ruamel.yaml import YAML

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.core.box import Box
from strandcast.core.trajectory import JointTrajectory
from strandcast.lab.driver import joint_log
from strandcast.lab.film import interpolated
from strandcast.lab.strings import PAPER_STRINGS
from strandcast.lab.swing import LabSwing, simulate_swing
from strandcast.lab.truth import true_miss
from strandcast.lab.variation import draw_clocks, draw_variation
from strandcast.records.files import write_text
from strandcast.records.track import read_track
from strandcast.seeds import rng
from strandcast.workflow.project import make_project
from strandcast_studies.benchmarks.video.cases import VideoCase
from strandcast_studies.benchmarks.video.motion import draw_swing
from strandcast_studies.second_renderer.film import (
    PHOTOS,
    Filming,
    board_photo,
    sensed,
    still_scene,
    thread_of,
    write_film,
)
from strandcast_studies.second_renderer.render import INSTANTS
from strandcast_studies.second_renderer.rigs import RIGS, FilmedRig, experiment_of, optics_of

FARTHEST_M = 0.015  # of the target from the tip's true path
COUNTED_S = 0.3  # after the motion's end
LEAD_S = 0.12  # of the film before the motion
MOTIONS = (2, 4, 6)
SERVO = "stiff"
BOX = Box(x_m=(-0.85, 1.05), y_m=(-0.40, 0.80))


def motion(root: Path, arm: PlanarArm, number: int) -> JointTrajectory:
    """Return one of the study's motions, drawn once for a string of the lab: rigs share them."""
    kept = root / "rig" / f"motion-{number}.npz"
    if not kept.exists():
        kept.parent.mkdir(exist_ok=True)
        case = VideoCase(f"second-{number}", number, "paper-4", "brisk", "plain", 0.0, 0.0)
        still = draw_variation(rng(case.name, 1, 1, "lab-throw"), len(arm.joints), 0.0)
        swing, motion_s = draw_swing(case, arm, PAPER_STRINGS["paper-4"], still, BOX)
        rows = np.flatnonzero((swing.time_s > -1e-9) & (swing.time_s < motion_s + 1e-9))
        np.savez(
            kept, time_s=swing.time_s[rows], q_rad=swing.command_rad[rows], qd_rad_s=swing.command_rad_s[rows]
        )
    with np.load(kept) as drawn:
        speeds = drawn["qd_rad_s"]
        return JointTrajectory(
            drawn["time_s"], drawn["q_rad"], speeds, np.gradient(speeds, drawn["time_s"], axis=0)
        )


def film_throw(root: Path, name: str, rig: FilmedRig, arm: PlanarArm) -> None:
    """Write the experiment's files, the photos, the film, the joint log and, beside them, the truth."""
    folder = root / "data" / name
    if (folder / "truth.json").exists():
        return
    random = rng(name, 1, 1, "second-renderer")
    optics = optics_of(rig, rng(name.rpartition("-")[0], 1, 1, "second-renderer-camera"))
    variation = draw_variation(random, len(arm.joints), 1.0)
    command = motion(
        root, arm, MOTIONS[(list(RIGS).index(name.rpartition("-")[0]) + int(name[-1])) % len(MOTIONS)]
    )
    motion_s = float(command.time_s[-1])
    swing = simulate_swing(arm, SERVO, rig.string, variation, command)
    late = np.flatnonzero((swing.time_s > 0.6 * motion_s) & (swing.time_s < motion_s + 0.15))
    angle, away = random.uniform(0, 2 * np.pi), random.uniform(0.0, FARTHEST_M)
    target_m = swing.nodes_m[random.choice(late), -1] + away * np.array([np.cos(angle), np.sin(angle)])
    target_m = np.round(target_m, 4)
    still = still_scene(rig, optics, target_m, random)
    (folder / "calibration").mkdir(parents=True, exist_ok=True)
    for number in range(1, PHOTOS + 1):
        photo = sensed(rig, board_photo(optics, random), random, 8)
        cv2.imwrite(str(folder / "calibration" / f"lens-{number:02d}.png"), photo)
    cv2.imwrite(str(folder / "calibration" / "plane.png"), sensed(rig, still, random, 8))
    with (folder / "experiment.yaml").open("w") as file:
        YAML().dump(experiment_of(rig, optics, target_m), file)
    clocks = draw_clocks(random)
    count = round((LEAD_S + motion_s + COUNTED_S) * rig.rate_hz)
    middles_s = np.arange(count) / rig.rate_hz * (1.0 + clocks.drift) - LEAD_S * random.uniform(0.8, 1.0)
    filming = Filming(rig, optics, arm, still, random)
    thread = thread_of(rig, swing.places_m, random)
    suffix = ".mkv" if rig.codec == "ffv1" else ".mp4"
    trial = folder / "trial-01"
    write_film(trial / f"video{suffix}", filming.frames(_moments(swing, middles_s, rig, random), thread), rig)
    write_log(folder / "log.csv", arm, swing, variation, clocks, motion_s, random)
    truth = {
        "miss_m": true_miss(swing, target_m, motion_s)[0],
        "tip_m": interpolated(swing, middles_s)[1][:, -1].tolist(),
        "before_tip_m": interpolated(swing, middles_s)[1][:, -2].tolist(),
        "free_m": float(swing.places_m[-1]),
        "motion_s": motion_s,
    }
    write_text(folder / "truth.json", json.dumps(truth))


def _moments(
    swing: LabSwing, middles_s: np.ndarray, rig: FilmedRig, random: np.random.Generator
) -> Iterator[Any]:
    for middle_s in middles_s:
        shares = (np.arange(INSTANTS) + random.uniform(size=INSTANTS)) / INSTANTS - 0.5
        yield interpolated(swing, middle_s + rig.exposure_s * random.permutation(shares))


def write_log(
    path: Path, arm: PlanarArm, swing: LabSwing, variation: Any, clocks: Any, motion_s: float, random: Any
) -> None:
    """Write the joint log as ur_rtde's recorder does."""
    log = joint_log(arm, swing, variation, clocks, motion_s, random)
    parts = {
        "actual_q": log.q_rad,
        "actual_qd": log.qd_rad_s,
        "target_q": log.q_cmd_rad,
        "target_qd": log.qd_cmd_rad_s,
    }
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["timestamp", *(f"{part}_{j}" for part in parts for j in range(len(arm.joints)))])
        rows.writerows(np.column_stack([log.time_s, *parts.values()]).tolist())


def measure(root: Path, name: str) -> dict[str, Any]:
    """Run the commands on a throw; return what the verdict says, and what is true."""
    results, data = root / "results" / name, root / "data" / name
    tool = [sys.executable, "-m"]
    if not (data / "trial-01" / "run.json").exists():
        command = [
            *tool,
            "strandcast",
            "import",
            "joints",
            name,
            "1",
            str((data / "log.csv").relative_to(root)),
        ]
        subprocess.run(command, cwd=root, check=True, capture_output=True)
    wanted = f"results/{name}/trial-01/verdict.json"
    command = [*tool, "snakemake", "--cores", "1", "--nolock", "--quiet", "all", "--", wanted]
    done = subprocess.run(command, cwd=root, check=False, capture_output=True, text=True)
    truth = json.loads((data / "truth.json").read_text())
    if not (root / wanted).exists():
        return {"name": name, "failed": done.stderr[-300:]}
    verdict = json.loads((root / wanted).read_text())
    summary = json.loads((results / "trial-01" / "track.json").read_text())
    track = read_track(results / "trial-01" / "track.parquet", summary["points"])
    tip, end = np.array(truth["tip_m"]), np.array(truth["before_tip_m"])
    seen = np.isfinite(track.points_m[:, -1, 0]) & (track.flags[:, -1] == 0) & (track.frame < len(tip))
    at = track.frame[seen]
    off, along = track.points_m[seen, -1] - tip[at], tip[at] - end[at]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    off_along, off_across = (off * along).sum(axis=1), off[:, 1] * along[:, 0] - off[:, 0] * along[:, 1]
    known = None not in (verdict["miss_m"], verdict["miss_sigma_m"])
    return {
        "name": name,
        "miss_m": verdict["miss_m"],
        "true_m": truth["miss_m"],
        "sigma_m": verdict["miss_sigma_m"],
        "z": (verdict["miss_m"] - truth["miss_m"]) / verdict["miss_sigma_m"] if known else None,
        "along_m": [float(np.median(off_along)), float(np.sqrt(np.mean(off_along**2)))],
        "across_m": float(np.sqrt(np.mean(off_across**2))),
        "stated_m": float(np.sqrt(np.mean(track.sigma_m[seen, -1] ** 2))),
        "warnings": summary["warnings"],
        "choices": summary["choices"],
        "free_m": truth["free_m"],
    }


HEAD = f"{'throw':20}{'miss':>7}{'true':>7}{'sigma':>7}{'z':>7}{'along':>7}{'across':>8}{'stated':>8}"


def line(found: dict[str, Any]) -> str:
    """Return a throw as a row [mm]: the tip's median error along, rms across, and its stated sigma last."""
    if found.get("z") is None:
        return f"{found['name']:20}{found.get('failed', 'no miss is known')}"
    miss, true, sigma, across, stated = (
        1e3 * found[key] for key in ("miss_m", "true_m", "sigma_m", "across_m", "stated_m")
    )
    along = 1e3 * found["along_m"][0]
    return (
        f"{found['name']:20}{miss:7.2f}{true:7.2f}{sigma:7.2f}{found['z']:7.2f}"
        f"{along:7.2f}{across:8.2f}{stated:8.2f}"
    )


def main(arguments: list[str] | None = None) -> None:
    """Film and measure the rigs that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", nargs="*", choices=RIGS, default=list(RIGS))
    parser.add_argument("--throws", type=int, default=3)
    parser.add_argument("--root", type=Path, default=Path("results/second-renderer"))
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args(arguments)
    root = given.root.absolute()
    if not (root / "Snakefile").exists():
        make_project(root)
    arm = load_arm(root / "config" / "arms" / "planar3.toml").planar()
    for number in MOTIONS:  # before the threads, which share them
        motion(root, arm, number)
    names = [(f"{rig}-{k}", rig) for k in range(1, given.throws + 1) for rig in given.rigs]

    print(HEAD)

    def one(name: str, rig: str) -> dict[str, Any]:
        film_throw(root, name, RIGS[rig], arm)
        found = measure(root, name)
        print(line(found), flush=True)
        return found

    with ThreadPoolExecutor(given.jobs) as pool:
        found = list(pool.map(one, *zip(*names, strict=True)))
    z = np.array([each["z"] for each in found if each.get("z") is not None])
    rms, middle = np.sqrt(np.mean(z**2)), np.median(np.abs(z))
    print(f"{len(z)} of {len(found)} throws: rms of z {rms:.2f}, median |z| {middle:.2f}")
    write_text(root / "found.json", json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
