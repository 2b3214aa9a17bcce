"""Statements of kept runs are compared, each experiment calibrated on the others."""

import numpy as np

from strandcast_studies.benchmarks.loop.restate import VARIANTS, compared


def test_the_statement_that_follows_the_misses_is_seen_to() -> None:
    random = np.random.default_rng(4)
    throws = []
    for run in range(40):
        size = float(np.exp(random.normal(0.0, 1.0)))
        miss_m = 0.004 * size * float(random.rayleigh())
        fixed, known = ({"rms_m": rms_m, "simulated": 1.0} for rms_m in (0.004, 0.004 * size))
        said = dict.fromkeys(VARIANTS, fixed) | {"known": known}
        throws.append({"run": f"r{run}", "trial": 1, "kind": "first", "miss_m": miss_m, "statements": said})
    rows = {row["variant"]: row for row in compared(throws, 0.02, shipped=False)}
    assert rows["known"]["throws"] == 40
    for row in rows.values():
        assert abs(row["below_p50"] - 0.5) <= 0.1
        assert abs(row["below_p90"] - 0.9) <= 0.1
        assert row["hits"] == np.mean([throw["miss_m"] <= 0.02 for throw in throws])
    assert rows["known"]["spread"] < 0.75 * rows["typical"]["spread"]
    assert rows["known"]["log_loss"] < rows["typical"]["log_loss"]
    # As shipped, the statements are those of motions that missed by more.
    shipped = {row["variant"]: row for row in compared(throws, 0.02, shipped=True)}
    assert shipped["known"]["below_p90"] > rows["known"]["below_p90"]
