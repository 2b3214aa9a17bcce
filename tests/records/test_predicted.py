"""predicted.parquet: what is written is read again; a file that does not fit together is refused."""

from pathlib import Path

import numpy as np
import pytest

from strandcast.errors import StrandcastError
from strandcast.records.predicted import (
    PREDICTED_THROWS,
    UNPREDICTED,
    PredictedThrows,
    read_predicted,
    write_predicted,
)
from strandcast.records.tables import write_table

THROWS = PredictedThrows(
    np.array([0.01, 0.02, 0.03]),
    np.array([0, 2]),
    np.array([0.0, 0.004]),
    np.array([[[0.12344, 0.5], [0.1, 0.6]], [[0.2, 0.5], [np.nan, np.nan]]]),
    "a" * 64,
)


def test_throws_are_read_as_written_to_a_tenth_of_a_millimetre(tmp_path: Path) -> None:
    write_predicted(tmp_path / "predicted.parquet", THROWS)
    found = read_predicted(tmp_path / "predicted.parquet")
    for name in ("miss_m", "throw", "time_s"):
        np.testing.assert_array_equal(getattr(found, name), getattr(THROWS, name))
    assert found.tip_m[0, 0, 0] == 0.1234
    np.testing.assert_allclose(found.tip_m, THROWS.tip_m, atol=5e-5)
    assert found.motion_sha256 == "a" * 64


def test_no_throws_are_written_too(tmp_path: Path) -> None:
    write_predicted(tmp_path / "predicted.parquet", UNPREDICTED)
    assert read_predicted(tmp_path / "predicted.parquet").tip_m.shape == (0, 0, 2)


@pytest.mark.parametrize(
    ("throw", "facts"),
    [
        ([0, 3], {"miss_m": [0.1, 0.2], "motion_sha256": ""}),
        ([0, 1], {"motion_sha256": ""}),
        ([0, 1], {"miss_m": "x", "motion_sha256": ""}),
    ],
)
def test_a_path_without_its_miss_is_refused(
    tmp_path: Path, throw: list[int], facts: dict[str, object]
) -> None:
    columns = {"throw": throw, "time_s": [0.0, 0.0], "x_m": [0.1, 0.2], "y_m": [0.1, 0.2]}
    write_table(tmp_path / "predicted.parquet", PREDICTED_THROWS, columns, facts)
    with pytest.raises(StrandcastError) as caught:
        read_predicted(tmp_path / "predicted.parquet")
    assert caught.value.code == "SC-R001"
