"""lab_truth.parquet: the true places of the lab's string; for tests and the report's "lab truth" panel."""

from strandcast.records.tables import Column, TableSpec

# The lab's string in the middle of every frame's exposure, at places along it from the clamp (0) to the tip.
# Facts stored beside the table: the clocks, the true miss, the throw's disturbances.
LAB_TRUTH = TableSpec(
    "strandcast/lab-truth",
    {
        "frame": Column("i4", "1"),
        "robot_time_s": Column("f8", "s"),  # the true one
        "place_m": Column("f8", "m"),
        "x_m": Column("f8", "m"),
        "y_m": Column("f8", "m"),
    },
    optional={"z_m": Column("f8", "m")},
)
