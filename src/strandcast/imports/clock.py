"""Times that no log and no film of a throw has, and the clocks of what was measured elsewhere."""

import numpy as np

from strandcast.records.alignment import Alignment

SHORTEST_STEP_S = 1e-6  # a million rows per second: the fastest cameras take 1e5 frames, controllers 1e3 rows
SLOWEST_STEP_S = 0.2  # five rows per second: the rows of a throw are 0.5 to 33 ms apart
LONGEST_S = 86400.0  # chosen: a bag may hold a day's work, a throw lasts seconds
COARSEST_S = 1e-5  # steps of the clock's own numbers; an alignment is good to 1e-4 s


def clock_problem(time_s: np.ndarray, slowest_s: float = SLOWEST_STEP_S) -> str | None:
    """Return what is wrong with rising times (T,), with the number that shows it; None if nothing is."""
    steps = np.diff(time_s)
    if not (steps > 0).any():
        return f"all {len(time_s)} rows are at {time_s[0]:.6g} s"
    usual_s, span_s = float(np.median(steps[steps > 0])), float(time_s[-1] - time_s[0])
    resolution_s = float(np.spacing(np.abs(time_s).max()))
    if span_s > LONGEST_S:
        return f"the times span {span_s:.3g} s, a throw lasts seconds"
    if resolution_s > COARSEST_S:
        return f"times like {time_s[-1]:.3g} s are only exact to {resolution_s:.2g} s"
    if not SHORTEST_STEP_S <= usual_s <= slowest_s:
        return f"the rows are {usual_s:.2g} s apart, {1 / usual_s:.2g} per second"
    return None


def supplied_clock(
    experiment: str,
    trial: int,
    frames: int,
    motion_s: tuple[float, float],
    offset_s: float = 0.0,
    offset_se_s: float | None = None,
    residual_rms_m: float | None = None,
) -> Alignment:
    """Return the alignment of a supplied clock with the robot's, by default of one clock with itself."""
    return Alignment(
        experiment=experiment,
        trial=trial,
        source="supplied",
        offset_s=offset_s,
        offset_se_s=offset_se_s,
        drift=0.0,
        drift_se=None,
        drift_prior=None,
        residual_rms_m=residual_rms_m,
        frames=frames,
        motion_start_s=motion_s[0],
        motion_end_s=motion_s[1],
    )
