"""Motion captures as tables of numbers: CSV, Parquet, C3D."""

from pathlib import Path

import numpy as np
import pyarrow as pa

from strandcast.imports.c3d_files import SUFFIX, read_c3d
from strandcast.imports.table import NumberTable, read_numbers
from strandcast.records.tables import read_parquet


def read_capture(path: str | Path) -> NumberTable:
    """Read a motion capture: Parquet or C3D by the file's name, else CSV; see the readers for the errors."""
    path = Path(path)
    if path.suffix.lower() == ".parquet":
        return _read_parquet_numbers(path)
    if path.suffix.lower() == SUFFIX:
        return read_c3d(path)
    return read_numbers(path)


def _read_parquet_numbers(path: Path) -> NumberTable:
    table = read_parquet(path)
    kept = [
        name
        for name, kind in zip(table.column_names, table.schema.types, strict=True)
        if pa.types.is_floating(kind) or pa.types.is_integer(kind)
    ]
    values = [table.column(name).cast(pa.float64(), safe=False).to_numpy() for name in kept]
    rows = table.num_rows
    return NumberTable(path, kept, np.array(values).reshape(len(kept), rows).T, 1 + np.arange(rows), True)
