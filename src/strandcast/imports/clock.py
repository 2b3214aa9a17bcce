"""Times that no log and no film of a throw has."""

import numpy as np

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
