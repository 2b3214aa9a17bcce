"""Motion captures in C3D files, read by the optional package `c3d`."""

import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.errors import ENVIRONMENT, StrandcastError
from strandcast.imports.table import NumberTable
from strandcast.records.record import refusal
from strandcast.records.tables import MOST_BYTES, MOST_CELLS

SUFFIX = ".c3d"


def read_c3d(path: Path) -> NumberTable:
    """Read all points of a C3D file: columns LABEL.x, LABEL.y, LABEL.z, with the file's rate and unit.

    Points that the file marks as not measured are NaN.

    Raises
    ------
    StrandcastError
        SC-I044 the package is not installed; SC-I045 the file cannot be read.
    """
    try:
        reader_of: Any = import_module("c3d").Reader
    except ImportError:
        raise StrandcastError(
            "SC-I044",
            "reading a C3D file needs the package c3d",
            file=path,
            fix='pip install "strandcast[c3d]", or export the capture as CSV',
            exit_code=ENVIRONMENT,
        ) from None
    if not path.is_file() or path.stat().st_size > MOST_BYTES:
        raise refusal("SC-I045", path, None, "is missing or far too large", "check the path")
    try:
        with path.open("rb") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of analog data, which are not read
            reader = reader_of(file)
            if int(reader.frame_count) * int(reader.point_used) * 3 > MOST_CELLS:
                raise ValueError(f"{reader.frame_count} frames of {reader.point_used} points")
            names = [str(label).strip() for label in reader.point_labels[: reader.point_used]]
            points = np.array([each[1] for each in reader.read_frames()], dtype=float)
            rate_hz, unit = float(reader.point_rate), str(reader.get_string("POINT:UNITS")).strip()
    # The library asserts, and takes a file's numbers for granted.
    except Exception as error:
        what = f"cannot be read as C3D ({type(error).__name__}: {error})"
        raise refusal("SC-I045", path, None, what, "export it again") from None
    if not len(points) or not rate_hz > 0:
        raise refusal("SC-I045", path, None, "it has no frames of points, or no rate", "export it again")
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise refusal("SC-I045", path, twice, "two points have this label", "rename one of them")
    values = np.where(points[..., 3:4] < 0.0, np.nan, points[..., :3]).reshape(len(points), -1)
    return NumberTable(
        path,
        [f"{name}.{axis}" for name in names for axis in "xyz"],
        values,
        1 + np.arange(len(points)),
        True,
        rate_hz=rate_hz,
        length_unit=unit or None,
    )
