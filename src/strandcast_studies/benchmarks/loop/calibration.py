"""Count how far throws really miss: make `planning/miss_calibration.json`, or check it on other experiments.

    python -m strandcast_studies.benchmarks.loop.calibration fit results/bench-wide.json
    python -m strandcast_studies.benchmarks.loop.calibration check results/bench-drawn.json
    python -m strandcast_studies.benchmarks.loop.calibration held-out results/bench-wide.json

Runs come from `loop.drawn`, or with ``--space`` from `space.run`; ``fit`` changes the kinds of these only. It
takes experiments that nothing else was tuned on; ``check`` prints, for experiments that ``fit`` has not
seen, which share of throws stayed below the stated quantiles and between the deciles, the stated hit
probability against the share that hit, CRPS, and Brier and log loss, calibrated and as simulated.
``held-out`` prints the same with every experiment stated by a calibration on the others; ``--alone`` states
every throw without what the experiment's own throws say.
"""

import argparse
import json
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize

from strandcast.core.shares import wilson
from strandcast.planning.miss_calibration import (
    COUNTED_AS,
    FILE,
    FITTED,
    IN_SPACE,
    LEVELS,
    NO_EVIDENCE,
    UNTESTED_SHARE,
    Evidence,
    KindCalibration,
    MissCalibration,
    MissDistribution,
)

FEWEST = 19  # throws of a kind: of fewer, the next throw's miss exceeds all with more than 5 %
COUNTED = 0.9  # share of the counted motions; chosen: the few beyond it do not say how misses grow
SHARES, BIN = (0.5, 0.9), 0.1


class CountedThrow(NamedTuple):
    """A throw of a run: its kind, number, simulated rms, simulated hit probability and true miss [m].

    `measured_m` is the miss that the planner of the next throw knows, `untested_m` that of `Evidence`.
    """

    kind: str
    trial: int
    rms_m: float
    simulated: float
    miss_m: float
    measured_m: float | None = None
    untested_m: float = 0.0


StatedThrow = tuple[CountedThrow, MissDistribution]


def throws_of(files: list[Path], suffix: str = "") -> list[list[CountedThrow]]:
    """Return the throws of each run, that before a rehearsal too, with kinds + `suffix`."""
    runs = [run for file in files for run in json.loads(file.read_text(encoding="utf-8"))["runs"]]
    return [
        [_counted(t, [], suffix) for t in run.get("unrehearsed", [])]
        + [_counted(t, run["trials"][:k], suffix) for k, t in enumerate(run["trials"])]
        for run in runs
    ]


def _counted(thrown: dict[str, Any], before: list[dict[str, Any]], suffix: str) -> CountedThrow:
    """Return a throw of a run, after others."""
    untested_m = 0.0
    if thrown["kind"] == "replanned":
        untested_m = before[-1].get("E_m") or 0.0
    elif thrown["kind"] == "refined":
        untested_m = UNTESTED_SHARE * min(_measured_m(t) for t in before)
    return CountedThrow(
        thrown["kind"] + suffix,
        thrown["trial"],
        thrown["miss_rms_m"],
        thrown["simulated_hit_probability"],
        thrown["true_miss_m"],
        _measured_m(thrown),
        untested_m,
    )


def _measured_m(thrown: dict[str, Any]) -> float:
    """Return the measured miss [m], or the true one where the tip was not seen."""
    measured_m = thrown.get("miss_m")
    return float(thrown["true_miss_m"] if measured_m is None else measured_m)


def kind_calibration(rms_m: np.ndarray, miss_m: np.ndarray, made_from: str = "") -> KindCalibration:
    """Return the floor and gain with the least spread of log(miss / s), and the quantiles of miss / s.

    Parameters
    ----------
    rms_m, miss_m
        (N,) rms of the simulated misses, and the misses [m].
    made_from
        The runs.
    """
    log_miss = np.log(np.maximum(miss_m, 1e-4))

    def spread(log_floor: np.ndarray) -> float:
        off = log_miss - np.log(np.exp(log_floor[0]) + rms_m)
        return float(np.abs(off - np.median(off)).mean())

    starts = np.log([1e-4, 1e-3, 5e-3, 2e-2, 1e-1])
    best = min((minimize(spread, [start], method="Nelder-Mead") for start in starts), key=lambda r: r.fun)
    floor_m = float(np.exp(best.x[0]))
    ratio = miss_m / (floor_m + rms_m)
    middle = float(np.median(ratio))
    # The next throw stays below these with the stated probability: (N + 1) p, as in conformal prediction.
    at = np.clip(np.array(LEVELS) * (len(ratio) + 1) / len(ratio), 0.0, 1.0)
    ratios = np.maximum.accumulate(np.quantile(ratio / middle, at))
    return KindCalibration(
        made_from=made_from,
        throws=len(ratio),
        floor_m=middle * floor_m,
        gain=middle,
        counted_m=float(np.quantile(rms_m, COUNTED)),
        ratios=np.round(ratios, 4).tolist(),
    )


def fit(throws: list[CountedThrow], made_from: str) -> MissCalibration:
    """Return the calibration of every kind with enough throws."""
    by_kind: dict[str, list[CountedThrow]] = defaultdict(list)
    for throw in throws:
        by_kind[COUNTED_AS.get(throw.kind, throw.kind)].append(throw)
    kinds = {}
    for kind, counted in by_kind.items():
        if len(counted) >= FEWEST:
            rms_m = np.array([np.hypot(throw.rms_m, throw.untested_m) for throw in counted])
            kinds[kind] = kind_calibration(rms_m, np.array([throw.miss_m for throw in counted]), made_from)
    return MissCalibration(kinds=dict(sorted(kinds.items())))


def held_out(runs: list[list[CountedThrow]], *, alone: bool = False) -> list[StatedThrow]:
    """Return the throws with what a calibration on all other runs states, of the kinds counted there."""
    said = []
    for k, run in enumerate(runs):
        others = fit([throw for one in runs[:k] + runs[k + 1 :] for throw in one], "")
        said += stated_run(run, others, alone=alone)
    return said


def stated(
    throw: CountedThrow, calibration: MissCalibration, evidence: Evidence = NO_EVIDENCE
) -> MissDistribution:
    """Return the calibrated distribution of a throw's miss."""
    return calibration.kinds[COUNTED_AS.get(throw.kind, throw.kind)].distribution(throw.rms_m, evidence)


def stated_run(
    run: list[CountedThrow], calibration: MissCalibration, *, alone: bool = False
) -> list[StatedThrow]:
    """Return the throws of an experiment, of kinds that were counted, with what is stated of each.

    `alone`: without what the experiment's own throws say.
    """
    said: list[StatedThrow] = []
    surprises: tuple[float, ...] = ()
    for throw in run:
        if COUNTED_AS.get(throw.kind, throw.kind) in calibration.kinds:
            evidence = NO_EVIDENCE if alone else Evidence(throw.untested_m, surprises)
            said.append((throw, stated(throw, calibration, evidence)))
            if throw.kind.removesuffix(IN_SPACE) in FITTED and throw.measured_m is not None:
                surprises += (throw.measured_m / said[-1][1].quantile_m(0.5),)
    return said


def reliability(pairs: list[StatedThrow], radius_m: float) -> dict[str, Any]:
    """Return how often stated quantiles and probabilities held."""
    throws, said = [throw for throw, _ in pairs], [one for _, one in pairs]
    miss = np.array([throw.miss_m for throw in throws])
    hit = miss <= radius_m
    answer: dict[str, Any] = {"throws": len(throws), "hits": int(hit.sum())}
    for share in SHARES:
        below = miss <= [one.quantile_m(share) for one in said]
        answer[f"below_p{round(100 * share)}"] = _share(below)
    place = [one.within(m) for m, one in zip(miss, said, strict=True)]
    answer["in_deciles"] = np.histogram(place, np.linspace(0.0, 1.0, 11))[0].tolist()
    answer["crps_m"] = float(np.mean([crps_m(one, m) for m, one in zip(miss, said, strict=True)]))
    simulated = np.array([throw.simulated for throw in throws])
    for name, probability in (
        ("calibrated", np.array([one.within(radius_m) for one in said])),
        ("simulated", simulated),
    ):
        safe = np.clip(probability, 0.005, 0.995)  # a stated 1 that fails would cost infinitely much
        answer[name] = {
            "mean": float(probability.mean()),
            "brier": float(np.mean((probability - hit) ** 2)),
            "log_loss": float(-np.mean(np.where(hit, np.log(safe), np.log(1.0 - safe)))),
            "bins": [
                {"stated": float(probability[inside].mean())} | _share(hit[inside])
                for low in np.arange(0.0, 1.0, BIN)
                if (inside := (probability >= low) & (probability < low + BIN + 1e-9 * (low > 0.85))).any()
            ],
        }
    return answer


def crps_m(said: MissDistribution, miss_m: float) -> float:
    """Return the continuous ranked probability score [m]: twice the mean of the quantiles' pinball losses."""
    over_m = miss_m - said.quantiles_m
    return float(2.0 * np.mean(np.maximum(np.array(LEVELS) * over_m, (np.array(LEVELS) - 1.0) * over_m)))


def _share(held: np.ndarray) -> dict[str, float]:
    low, high = wilson(int(held.sum()), len(held))
    return {"of": len(held), "share": float(held.mean()), "low": low, "high": high}


def main(arguments: list[str] | None = None) -> None:
    """Fit, check or hold out."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("fit", "check", "held-out"))
    parser.add_argument("files", nargs="+", type=Path, help="results of loop.drawn or space.run")
    parser.add_argument("--space", action="store_true", help="the results are those of space.run")
    parser.add_argument("--radius", type=float, default=0.020, help="hit radius [m]")
    parser.add_argument("--alone", action="store_true", help="state without the experiment's own throws")
    parser.add_argument("--out", type=Path, default=FILE, help="where fit writes the calibration")
    options = parser.parse_args(arguments)
    runs = throws_of(options.files, IN_SPACE if options.space else "")
    throws = [throw for run in runs for throw in run]
    before = MissCalibration(kinds={})
    if options.out.exists():
        before = MissCalibration.model_validate_json(options.out.read_text(encoding="utf-8"))
    if options.what == "fit":
        made = fit(throws, ", ".join(sorted(file.stem for file in options.files)))
        made = MissCalibration(kinds=dict(sorted((before.kinds | made.kinds).items())))
        options.out.write_text(made.model_dump_json(indent=1) + "\n", encoding="utf-8")
        return
    if options.what == "held-out":
        said = held_out(runs, alone=options.alone)
    else:
        said = [pair for run in runs for pair in stated_run(run, before, alone=options.alone)]
    for trial in sorted({throw.trial for throw, _ in said}):
        mine = [pair for pair in said if pair[0].trial == trial]
        print(f"trial {trial}:", json.dumps(reliability(mine, options.radius), indent=1))


if __name__ == "__main__":
    main()
