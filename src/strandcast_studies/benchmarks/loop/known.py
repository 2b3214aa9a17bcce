"""A string that was thrown in one experiment, in another one: the first throw with `start_string: {from: …}`.

    python -m strandcast_studies.benchmarks.loop.known --seeds 9001-9024 --out results/bench-known.json

Each seed draws a string, as `loop.drawn` does, that is thrown twice. Then it is thrown at another target by
joints that follow otherwise, in every second pair after up to a third of it was pulled into another clamp:
once from what was fitted, and twice as an unknown string. First motions are rehearsed, but not with
``--unrehearsed``.
"""

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.stages.run import run_stage
from strandcast_studies.benchmarks.loop import run as loop
from strandcast_studies.benchmarks.loop.drawn import ARM_M, OF_LENGTH, SERVOS, settings_of
from strandcast_studies.paper.cases import FILE, load_plan

PULLED, LEAST_PLACE_M = 1 / 3, 0.05  # most of the length, and least place of a weight that is left; chosen


def moved_settings_of(common: dict[str, Any], seed: int, rehearsed: bool) -> dict[str, Any]:
    """Return the settings with the same string, another target and servo, and every second time shorter."""
    random = np.random.default_rng([seed, 8])
    here, other = settings_of(common, seed), settings_of(common, seed + 100_000)
    places_m = [weight["place_m"] for weight in here["string"]["weights"]]
    most_m = min(PULLED * here["string"]["length_m"], min(places_m, default=1.0) - LEAST_PLACE_M)
    pulled_m = round(float(random.uniform(0.0, max(most_m, 0.0))), 3) * (seed % 2)
    length_m = round(here["string"]["length_m"] - pulled_m, 3)
    weights = [
        weight | {"place_m": round(weight["place_m"] - pulled_m, 3)} for weight in here["string"]["weights"]
    ]
    servos = [name for name in SERVOS if name != here["lab"]["servo"]]
    while np.hypot(*other["target_m"]) > ARM_M + OF_LENGTH * length_m:
        seed += 1
        other = settings_of(common, seed + 100_000)
    return here | {
        "string": here["string"] | {"length_m": length_m, "weights": weights},
        "target_m": other["target_m"],
        "lab": here["lab"] | {"servo": servos[random.integers(len(servos))], "rehearsal": rehearsed},
    }


def _job(root: str, seed: int, rehearsed: bool) -> dict[str, Any]:
    common, folder = load_plan(loop.PROJECT / FILE).common, Path(root)
    fitted, known, unknown = (f"{name}-{seed}" for name in ("fitted", "known", "unknown"))
    moved = moved_settings_of(common, seed, rehearsed)
    loop.prepare(folder, fitted, settings_of(common, seed))
    start = {"from": f"results/{fitted}/trial-02/estimate.json"}
    loop.prepare(folder, known, moved | {"start_string": start})
    loop.prepare(folder, unknown, moved)

    def fit() -> list[Any]:
        thrown = loop.run_prepared(folder, fitted, 2, loop.RIGS["usual"])
        run_stage("estimate", folder, fitted, 2)
        return thrown

    return {
        "seed": seed,
        "moved": {key: moved[key] for key in ("string", "target_m", "lab")},
        "fitted": loop.outcome(fit),
        "unknown": loop.outcome(lambda: loop.run_prepared(folder, unknown, 2, loop.RIGS["usual"])),
    } | loop.outcome(lambda: loop.run_prepared(folder, known, 1, loop.RIGS["usual"]))


def main(arguments: list[str] | None = None) -> None:
    """Run the pairs, two at a time; write each as soon as it is known."""
    options = loop.run_parser(__doc__, list(range(9001, 9025)), "results/bench-known.json", strings=False)
    options.add_argument("--unrehearsed", action="store_true", help="throw without a rehearsal")
    given = options.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="strandcast-known-") as folder:
        root = str(loop.root_with_arms(Path(folder)))
        jobs = [(root, seed, not given.unrehearsed) for seed in given.seeds]
        print(json.dumps(loop.run_jobs(_job, jobs, given.jobs, given.out)))


if __name__ == "__main__":
    main()
