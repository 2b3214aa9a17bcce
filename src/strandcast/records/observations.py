"""observations.parquet: one camera's detections of the string and of the hand's markers, in pixels."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from strandcast.records.tables import (
    Column,
    TableSpec,
    fitting,
    read_facts,
    read_table,
    scattered,
    write_table,
)

OBSERVATIONS = TableSpec(
    "strandcast/observations",
    {
        "camera": Column("str", "1"),
        "frame": Column("i4", "1"),
        "camera_time_s": Column("f8", "s"),
        "marker": Column("i4", "1"),  # id of a marker on the hand; -1: a mass point of the string
        "point": Column("i4", "1"),  # mass point, 0 the hand; of a marker: its corner, 0 to 3, as printed
        "u_px": Column("f8", "px"),
        "v_px": Column("f8", "px"),
        "var_uu_px2": Column("f8", "px2"),
        "cov_uv_px2": Column("f8", "px2"),
        "var_vv_px2": Column("f8", "px2"),
        "sigma_m": Column("f8", "m"),  # in the plane of motion, by the tracker; NaN: from the covariance
        "flags": Column("i4", "1"),
    },
)
STRING = -1  # in the column `marker`


class MarkerShape(NamedTuple):
    """A marker's side and its height over the string's plane, from which its corners give its pose."""

    size_m: float
    offset_m: float


@dataclass(frozen=True)
class StringPixels:
    """The mass points in pixels: F frames, n + 1 points, 0 the hand; NaN where not detected."""

    frame: np.ndarray  # (F,)
    camera_time_s: np.ndarray  # (F,)
    points_px: np.ndarray  # (F, n+1, 2)
    covariance_px2: np.ndarray  # (F, n+1, 2, 2)
    sigma_m: np.ndarray  # per axis in the plane of motion, (F, n+1); NaN where the tracker states none
    flags: np.ndarray  # (F, n+1)


@dataclass(frozen=True)
class MarkerPixels:
    """The hand's markers in pixels: K detections, ordered by frame, then by marker."""

    frame: np.ndarray  # (K,)
    camera_time_s: np.ndarray  # (K,)
    marker: np.ndarray  # (K,)
    corners_px: np.ndarray  # top left, top right, bottom right, bottom left as printed, (K, 4, 2)
    covariance_px2: np.ndarray  # of each corner, (K, 4, 2, 2)
    sigma_m: np.ndarray  # of the centre in the marker's plane, (K,); NaN where the tracker states none


@dataclass(frozen=True)
class Observations:
    """The detections of one camera; `shapes` are the markers on the hand by id."""

    camera: str
    string: StringPixels
    markers: MarkerPixels
    shapes: dict[int, MarkerShape]


def write_observations(path: str | Path, observed: Observations) -> None:
    """Write the observations of a camera."""
    parts = _columns_of(observed)
    columns = {name: np.concatenate([part[name] for part in parts]) for name in OBSERVATIONS.columns}
    shapes = {str(marker): shape._asdict() for marker, shape in observed.shapes.items()}
    facts = {"points": observed.string.points_px.shape[1] - 1, "markers": shapes}
    write_table(path, OBSERVATIONS, columns, {"cameras": {observed.camera: facts}})


def read_observations(path: str | Path) -> Observations:
    """Return the observations of a camera over the frames in which it detected something.

    Raises
    ------
    StrandcastError
        As `read_table`, and SC-R001 rows and facts do not fit together.
    """
    rows = read_table(path, OBSERVATIONS)
    with fitting(path):
        [(camera, facts)] = read_facts(path, OBSERVATIONS)["cameras"].items()
        of_string = rows["marker"] == STRING
        return Observations(
            camera,
            _read_string(_chosen(rows, of_string), facts["points"]),
            _read_markers(_chosen(rows, ~of_string)),
            {int(marker): MarkerShape(**shape) for marker, shape in facts["markers"].items()},
        )


def _columns_of(observed: Observations) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the columns of the string's rows and of the markers' rows."""
    string, markers = observed.string, observed.markers
    frame, point = np.nonzero(np.isfinite(string.points_px).all(axis=2))
    count = len(markers.frame)
    of_string = _pixel_columns(string.points_px[frame, point], string.covariance_px2[frame, point]) | {
        "camera": np.full(len(frame), observed.camera, dtype=object),
        "frame": string.frame[frame],
        "camera_time_s": string.camera_time_s[frame],
        "marker": np.full(len(frame), STRING, dtype=np.int32),
        "point": point,
        "sigma_m": string.sigma_m[frame, point],
        "flags": string.flags[frame, point],
    }
    corners_px, covariance_px2 = markers.corners_px.reshape(-1, 2), markers.covariance_px2.reshape(-1, 2, 2)
    of_markers = _pixel_columns(corners_px, covariance_px2) | {
        "camera": np.full(4 * count, observed.camera, dtype=object),
        "frame": np.repeat(markers.frame, 4),
        "camera_time_s": np.repeat(markers.camera_time_s, 4),
        "marker": np.repeat(markers.marker, 4),
        "point": np.tile(np.arange(4), count),
        "sigma_m": np.repeat(markers.sigma_m, 4),
        "flags": np.zeros(4 * count, dtype=np.int32),
    }
    return of_string, of_markers


def _pixel_columns(uv_px: np.ndarray, covariance_px2: np.ndarray) -> dict[str, np.ndarray]:
    return {
        "u_px": uv_px[:, 0],
        "v_px": uv_px[:, 1],
        "var_uu_px2": covariance_px2[:, 0, 0],
        "cov_uv_px2": covariance_px2[:, 0, 1],
        "var_vv_px2": covariance_px2[:, 1, 1],
    }


def _read_string(rows: dict[str, np.ndarray], points: int) -> StringPixels:
    frame, first, place = np.unique(rows["frame"], return_index=True, return_inverse=True)
    shape, at = (len(frame), points + 1), (place, rows["point"])
    uv_px, covariance_px2 = _pixels(rows)
    return StringPixels(
        frame,
        rows["camera_time_s"][first],
        scattered((*shape, 2), at, uv_px),
        scattered((*shape, 2, 2), at, covariance_px2),
        scattered(shape, at, rows["sigma_m"]),
        scattered(shape, at, rows["flags"], fill=0),
    )


def _read_markers(rows: dict[str, np.ndarray]) -> MarkerPixels:
    order = np.lexsort((rows["point"], rows["marker"], rows["frame"]))
    rows = _chosen(rows, order)
    uv_px, covariance_px2 = _pixels(rows)
    each = _chosen(rows, slice(None, None, 4))
    return MarkerPixels(
        each["frame"],
        each["camera_time_s"],
        each["marker"],
        uv_px.reshape(-1, 4, 2),
        covariance_px2.reshape(-1, 4, 2, 2),
        each["sigma_m"],
    )


def _pixels(rows: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels (K, 2) and their covariances (K, 2, 2) of rows."""
    names = ("var_uu_px2", "cov_uv_px2", "cov_uv_px2", "var_vv_px2")
    covariance_px2 = np.stack([rows[name] for name in names], axis=-1).reshape(-1, 2, 2)
    return np.stack([rows["u_px"], rows["v_px"]], axis=-1), covariance_px2


def _chosen(rows: dict[str, np.ndarray], chosen: Any) -> dict[str, np.ndarray]:
    return {name: column[chosen] for name, column in rows.items()}
