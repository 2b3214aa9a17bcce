"""Shares of a number of runs, with their uncertainty."""

import math

Z95 = 1.959963984540054  # quantile of the normal distribution for a two-sided 95 % interval


def wilson(hits: int, runs: int) -> tuple[float, float]:
    """Return the Wilson score interval of a share of `hits` out of `runs`; (0, 1) without runs.

    Notes
    -----
    E. B. Wilson, "Probable inference, the law of succession, and statistical inference", 1927. It stays
    within 0 and 1 and is not empty at shares of 0 and 1.
    """
    if not 0 <= hits <= runs:
        raise ValueError(f"{hits} hits out of {runs} runs")
    if runs == 0:
        return 0.0, 1.0
    z, share = Z95, hits / runs
    bend = z * z / runs
    middle = (share + 0.5 * bend) / (1.0 + bend)
    half = z * math.sqrt(share * (1.0 - share) / runs + 0.25 * bend / runs) / (1.0 + bend)
    # At shares of 0 and 1 the interval ends at 0 and 1 exactly; rounding must not exceed them.
    return (0.0 if hits == 0 else middle - half), (1.0 if hits == runs else middle + half)
