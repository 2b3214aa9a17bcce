"""Motion captures in C3D files, read by the optional package `ezc3d`."""

import re
from pathlib import Path

import numpy as np

from strandcast.imports.mapping import unit_named
from strandcast.imports.table import NumberTable
from strandcast.packages import optional_package
from strandcast.records.record import refusal
from strandcast.records.tables import MOST_BYTES

C3D = "C3D"
SUFFIX = ".c3d"


def read_c3d(path: Path) -> NumberTable:
    """Read all points of a C3D file: columns LABEL.x, LABEL.y, LABEL.z, with the file's rate, unit and up.

    Points that the file marks as not measured are NaN.

    Raises
    ------
    StrandcastError
        SC-W012 the package is not installed; SC-I001 the file cannot be read.
    """
    ezc3d = optional_package("ezc3d", "ezc3d", "c3d", ", or export the capture as CSV")
    if not path.is_file() or path.stat().st_size > MOST_BYTES:
        raise refusal("SC-I001", path, None, "is missing or far too large", "check the path")
    try:
        file = ezc3d.c3d(str(path))
        about = {name: each["value"] for name, each in file["parameters"]["POINT"].items() if "value" in each}
        points = np.moveaxis(file["data"]["points"][:3], 0, 2)  # (points, rows, 3)
        seen = file["data"]["meta_points"]["residuals"][0] >= 0.0
        # An array has 255 labels at most: the next ones are in LABELS2.
        parts = sorted(name for name in about if re.fullmatch(r"LABELS\d?", name))
        labels = [str(label).strip() for name in parts for label in about[name]]
        names = labels[: len(points)]
        rate_hz = float(about["RATE"][0])
    # The library raises what its numbers lead to.
    except Exception as error:
        what = f"cannot be read as C3D ({type(error).__name__}: {error})"
        raise refusal("SC-I001", path, None, what, "export it again") from None
    if not points.size:
        what = f"has {len(points)} points in {points.shape[1]} frames"
        raise refusal("SC-I001", path, None, what, "export the markers' trajectories with it")
    said = {str(unit).strip() for unit in about.get("UNITS", []) if str(unit).strip()}
    units = {unit_named(unit) or unit for unit in said}
    screen = str(next(iter(about.get("Y_SCREEN", [])), "")).strip().lower()
    names += [f"point {k + 1}" for k in range(len(names), len(points))]
    values = np.where(seen[..., None], points, np.nan)
    return NumberTable(
        path,
        [f"{name}.{axis}" for name in names for axis in "xyz"],
        np.moveaxis(values, 1, 0).reshape(points.shape[1], -1),
        1 + np.arange(points.shape[1]),
        True,
        maker=C3D,
        rate_hz=rate_hz if rate_hz > 0 else None,
        length_unit=units.pop() if len(units) == 1 else None,
        # Qualisys writes -Z where z points up: a minus is no evidence.
        up=screen[1:] if screen in ("+x", "+y", "+z") else None,
    )
