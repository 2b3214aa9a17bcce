"""lab_truth.parquet: where the lab's string was; for tests and the report's "lab truth" section."""

from __future__ import annotations

from strandcast.records.tables import Column, TableSpec

# The lab's chain at the middle of every frame's exposure, at places along the string from the clamp (0) to
# the tip. The facts beside the table are the lab's own: the clocks, the true miss, the throw's variation.
LAB_TRUTH = TableSpec(
    "strandcast/lab-truth",
    {
        "frame": Column("i4", "1"),
        "robot_time_s": Column("f8", "s"),  # the true one
        "place_m": Column("f8", "m"),
        "x_m": Column("f8", "m"),
        "y_m": Column("f8", "m"),
    },
)
