"""Calibration of the alignment's standard errors, on synthetic throws with known clocks.

``python -m strandcast_studies.evidence.clocks [--trials N]`` prints a table to standard error and JSON to
standard output; docs/explanation/alignment.md has the figures.
"""

import argparse
import json
import sys
import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from strandcast.alignment.align import RobotData, VideoData, align
from strandcast.arm.load import PlanarArm, load_arm
from strandcast.config.align import AlignSettings
from strandcast.errors import StrandcastError
from strandcast_studies.evidence.clock_trials import ARM_FILE, Faults, Recipe, clock_trial

TRIALS = 120
NORMAL = 1.96
WORN = Faults(late_s=0.3, stale=0.02, gap_s=0.02)
HALF_BLIND = Faults(lost=0.3, misread=0.05)
SHARP = Faults(
    camera_m=3e-4, camera_rad=1e-4, focal=1e-4, white_px=(0.01, 0.04), slow_px=(0.005, 0.03), blur_rad=0.0
)

KINDS = {
    "500 frames/s": Recipe(),
    "240 frames/s": Recipe(frame_rate_hz=240.0),
    "1000 frames/s": Recipe(frame_rate_hz=1000.0),
    "log late, repeated, with a hole": Recipe(faults=WORN),
    "markers lost 30 %, misread 5 %": Recipe(faults=HALF_BLIND),
    "a camera as good as the lab's": Recipe(faults=SHARP),
    "a string pulls at the arm": Recipe(string="paper-1"),
}


@dataclass(frozen=True)
class ClockCoverage:
    """Statistics of the alignments of one kind of throw; z is error over standard error."""

    kind: str
    trials: int
    refused: dict[str, int]  # number by error code
    z_rms: float
    z_mean: float
    z_largest: float
    within: float  # share of trials with the truth in the 95 % interval
    se_median_ms: float
    se_largest_ms: float
    error_rms_ms: float
    error_largest_ms: float
    drift_z_rms: float
    cpu_s: float


def coverage(arm: PlanarArm, kind: str, recipe: Recipe, seeds: range) -> ClockCoverage:
    """Align throws of one kind without prior information, and compare the offsets with the truth."""
    rows: list[tuple[float | None, ...]] = []
    refused: dict[str, int] = {}
    cpu_s = 0.0
    for seed in seeds:
        trial = clock_trial(arm, seed, recipe)
        before_s = time.process_time()
        try:
            video, robot = VideoData(trial.markers), RobotData(trial.log)
            found = align(video, robot, arm, AlignSettings(), experiment="clocks", trial=1)
        except StrandcastError as error:
            refused[error.code] = refused.get(error.code, 0) + 1
            continue
        finally:
            cpu_s += time.process_time() - before_s
        rows.append((*trial.error_s(found), found.drift - trial.drift, found.drift_se))
    error_s, se_s, drift, drift_se = np.array(rows, float).T
    z = error_s / se_s
    return ClockCoverage(
        kind=kind,
        trials=len(seeds),
        refused=refused,
        z_rms=rms(z),
        z_mean=float(z.mean()),
        z_largest=float(np.abs(z).max()),
        within=float((np.abs(z) < NORMAL).mean()),
        se_median_ms=float(np.median(se_s) * 1e3),
        se_largest_ms=float(se_s.max() * 1e3),
        error_rms_ms=rms(error_s) * 1e3,
        error_largest_ms=float(np.abs(error_s).max() * 1e3),
        drift_z_rms=rms(drift / drift_se),
        cpu_s=cpu_s / len(seeds),
    )


def rms(values: np.ndarray) -> float:
    """Return the root mean square."""
    return float(np.sqrt((values**2).mean()))


def line(found: ClockCoverage) -> str:
    """Return a row of the table in docs/explanation/alignment.md."""
    refused = ", ".join(f"{code} {count}" for code, count in found.refused.items()) or "none"
    return (
        f"| {found.kind} | {found.trials} | {found.z_rms:.2f} | {found.within:.1%} | {found.z_largest:.1f} | "
        f"{found.se_median_ms:.3f} / {found.se_largest_ms:.3f} | "
        f"{found.error_rms_ms:.3f} / {found.error_largest_ms:.3f} | {refused} | {found.cpu_s:.2f} |"
    )


def main() -> None:
    """Print the coverage of all kinds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--first", type=int, default=1000, help="seed of the first trial")
    options = parser.parse_args()
    arm = load_arm(ARM_FILE).planar()
    results: list[dict[str, Any]] = []
    for kind, recipe in KINDS.items():
        found = coverage(arm, kind, recipe, range(options.first, options.first + options.trials))
        print(line(found), file=sys.stderr, flush=True)
        results.append(asdict(found))
    print(json.dumps(results, indent=2, allow_nan=False))


if __name__ == "__main__":
    main()
