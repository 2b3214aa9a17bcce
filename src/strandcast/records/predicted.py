"""predicted.parquet: the throws that the planner expects of its motion, with the paths of their tips."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strandcast.records.tables import (
    Column,
    TableSpec,
    fitting,
    read_facts,
    read_table,
    scattered,
    write_table,
)
from strandcast.records.track import AXES

# One row per stored path and time. Facts stored beside the table: the miss of every throw, the motion's hash.
PREDICTED_THROWS = TableSpec(
    "strandcast/predicted",
    {
        "throw": Column("i4", "1"),  # place in the list of misses
        "time_s": Column("f8", "s"),  # from the motion's start
        "x_m": Column("f8", "m"),
        "y_m": Column("f8", "m"),
    },
    optional={"z_m": Column("f8", "m")},  # of throws in space
)
PLACE_DIGITS = 4  # 0.1 mm: less than a camera measures


class PredictedThrows(NamedTuple):
    """Throws of one motion, simulated with every plausible string and every disturbance."""

    miss_m: NDArray[np.float64]  # (B,) of each throw
    throw: NDArray[np.int64]  # (M,) which of the throws have their path stored
    time_s: NDArray[np.float64]  # (T,) from the motion's start
    tip_m: NDArray[np.float64]  # (M, T, 2 or 3) paths of their tips, NaN from where a simulation failed
    motion_sha256: str = ""  # content hash


UNPREDICTED = PredictedThrows(np.zeros(0), np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 0, 2)))


def write_predicted(path: str | Path, throws: PredictedThrows) -> None:
    """Write predicted throws, places rounded to 0.1 mm."""
    row, sample = np.indices(throws.tip_m.shape[:2]).reshape(2, -1)
    places_m = np.moveaxis(np.round(throws.tip_m, PLACE_DIGITS), 2, 0)
    columns = {"throw": throws.throw[row], "time_s": throws.time_s[sample]}
    columns |= {name: place_m.ravel() for name, place_m in zip(AXES, places_m, strict=False)}
    write_table(
        path,
        PREDICTED_THROWS,
        columns,
        {"motion_sha256": throws.motion_sha256, "miss_m": throws.miss_m.tolist()},
    )


def read_predicted(path: str | Path) -> PredictedThrows:
    """Read and verify predicted throws; see `read_table` for the errors."""
    rows, facts = read_table(path, PREDICTED_THROWS), read_facts(path, PREDICTED_THROWS)
    with fitting(path):
        throw, row = np.unique(rows["throw"], return_inverse=True)
        time_s, sample = np.unique(rows["time_s"], return_inverse=True)
        places_m = np.column_stack([rows[name] for name in AXES if name in rows])
        tip_m = scattered((len(throw), len(time_s), places_m.shape[1]), (row, sample), places_m)
        miss_m = np.array(facts["miss_m"], dtype=float).reshape(-1)
        miss_m[throw]  # every path has its miss
        return PredictedThrows(miss_m, throw.astype(np.int64), time_s, tip_m, str(facts["motion_sha256"]))
