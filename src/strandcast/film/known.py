"""What is known of a film before its string is tracked: scale, held ends, corrections by hand."""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from strandcast.camera.markers import marker_side_px
from strandcast.errors import StrandcastError
from strandcast.imports.table import read_numbers
from strandcast.records.camera import Camera
from strandcast.records.manifest import VideoFacts

NUMBER = r"\s*((?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*"
PIXEL = rf"{NUMBER},{NUMBER}"
CORRECTION = ["frame", "point", "u_px", "v_px"]


@dataclass(frozen=True)
class FilmKnown:
    """What is known of a film; what is not is found, or assumed, and said.

    Attributes
    ----------
    length_m
        Length of the string beyond its held end.
    scale
        See `scale_of`.
    held
        Its held end, or both; see `held_of`. Without any: where all frames agree.
    points
        Number n of points beyond the held end.
    polarity
        The string is ``dark`` or ``bright`` against what is behind it; ``auto``: by the film.
    colour
        Of the string, ``#rrggbb``: it is searched by its colour instead of its grey level.
    frame_rate_hz, exposure_s
        The camera's true frame rate, where the file states another; exposure time of a frame.
    dictionary
        Of OpenCV's markers.
    corrections
        A table of places by hand: columns frame, point, u_px, v_px.
    """

    length_m: float | None = None
    scale: str | float | None = None
    held: str | Sequence[str] = ()
    points: int = 20
    polarity: Literal["auto", "dark", "bright"] = "auto"
    colour: str | None = None
    frame_rate_hz: float | None = None
    exposure_s: float | None = None
    dictionary: str = "DICT_4X4_50"
    corrections: Path | None = None

    def __post_init__(self) -> None:
        """Refuse numbers that nothing can have (SC-W021)."""
        for name in ("length_m", "frame_rate_hz", "exposure_s"):
            if (value := getattr(self, name)) is not None and not 0 < value < np.inf:
                raise StrandcastError("SC-W021", f"{value} is not positive", field=name, fix="correct it")
        if self.points != int(self.points) or not 2 <= self.points <= 100:
            raise StrandcastError(
                "SC-W021", f"{self.points} is none of 2 to 100", field="points", fix="correct it"
            )
        if self.polarity not in ("auto", "dark", "bright"):
            fix = "give auto, dark or bright"
            raise StrandcastError("SC-W021", f"{self.polarity!r} is no polarity", field="polarity", fix=fix)


def _wrong(field: str, text: str, forms: str) -> StrandcastError:
    return StrandcastError("SC-W021", f"{text!r} is none of its forms", field=field, fix=f"give {forms}")


@dataclass(frozen=True, eq=False)
class Scale:
    """Metres per pixel, or the camera that knows them at every place; both None without a scale."""

    m_per_px: float | None
    camera: Camera | None
    words: str


def scale_of(
    text: str | float | None, pictures: Sequence[np.ndarray], dictionary: str, ids: Collection[int] = ()
) -> Scale:
    """Return the scale that a text gives.

    Its forms are ``0.0005`` metres per pixel, ``100,200:400,200=0.30`` two pixels and their distance [m],
    ``marker=0.04`` the side of the markers in the picture [m] (of those with the `ids`, if any are given), or
    the path of a camera's record.

    Raises
    ------
    StrandcastError
        SC-W021 it has none of these forms; SC-C002 no marker is found; others of reading the record.
    """
    if text is None:
        return Scale(None, None, "none: pixels")
    text = str(text)
    if text.endswith(".json"):
        return Scale(None, Camera.read(Path(text)), f"the camera of {text}")
    if points := re.fullmatch(rf"{PIXEL}:{PIXEL}={NUMBER}", text):
        u, v, to_u, to_v, distance_m = map(float, points.groups())
        apart_px = float(np.hypot(to_u - u, to_v - v))
        if distance_m > 0 and apart_px > 0:
            m_per_px = distance_m / apart_px
            return Scale(m_per_px, None, f"{in_mm(m_per_px)}, by two pixels {distance_m} m apart")
    marker = re.fullmatch(rf"marker={NUMBER}", text)
    if marker and float(marker[1]) > 0:
        if (side_px := marker_side_px(pictures, dictionary, ids)) is None:
            what, fix = (
                f"no marker of {dictionary} is in the picture",
                "give another dictionary, or another scale",
            )
            raise StrandcastError("SC-C002", what, field="scale", fix=fix)
        m_per_px = float(marker[1]) / side_px
        return Scale(m_per_px, None, f"{in_mm(m_per_px)}, by markers of {side_px:.1f} px")
    try:
        m_per_px = float(text)
    except ValueError:
        m_per_px = np.nan
    if 0 < m_per_px < np.inf:
        return Scale(m_per_px, None, f"{in_mm(m_per_px)}, as given")
    raise _wrong(
        "scale",
        text,
        "metres per pixel (0.0005), two pixels and their distance in metres (100,200:400,200=0.30), the side "
        "of markers in the picture (marker=0.04), or the .json of a camera",
    )


def in_mm(m_per_px: float) -> str:
    """Return a scale in words."""
    return f"{1e3 * m_per_px:.4g} mm per pixel"


@dataclass(frozen=True)
class HeldEnd:
    """A held end: its pixel in the first frame, whether it moves, and the marker that moves with it."""

    place_px: tuple[float, float] | None
    moves: bool = False
    marker: int | None = None

    def words(self) -> str:
        """Return how the end is known."""
        if self.place_px is None:
            return f"found beside marker {self.marker}, with which it moves"
        u, v = self.place_px
        at = f"given at ({u:g}, {v:g}) px in the first frame"
        if self.marker is not None:
            return f"{at}; it moves with marker {self.marker}"
        return at + ("; what holds it is followed" if self.moves else "; it stays there")


def held_of(text: str) -> HeldEnd:
    """Return the held end of a text: ``U,V`` still, ``moving:U,V``, ``marker:ID`` or ``marker:ID@U,V``.

    Raises
    ------
    StrandcastError
        SC-W021 it has none of these forms.
    """
    if pixel := re.fullmatch(rf"(moving:)?{PIXEL}", text):
        return HeldEnd((float(pixel[2]), float(pixel[3])), moves=bool(pixel[1]))
    if marker := re.fullmatch(rf"marker:(\d+)(?:@{PIXEL})?", text):
        place = None if marker[2] is None else (float(marker[2]), float(marker[3]))
        return HeldEnd(place, moves=True, marker=int(marker[1]))
    raise _wrong("held", text, "a pixel (640,120; if it moves moving:640,120), marker:7 or marker:7@640,120")


def corrections_of(path: Path, facts: VideoFacts, points: int) -> np.ndarray:
    """Return the rows (K, 4) of a table of corrections: frame, point, u and v.

    Raises
    ------
    StrandcastError
        SC-I004 a column is missing; SC-I025 a cell is no number; SC-I013 a frame or point is not in the film;
        others of `read_numbers`.
    """
    if (
        len(path.read_text(encoding="utf-8", errors="replace").strip().splitlines()) < 2
    ):  # none yet, or none left
        return np.zeros((0, 4))
    table = read_numbers(path)
    rows = table.columns(CORRECTION)
    table.require_finite(rows, CORRECTION)
    lasts = (facts.packets - 1, points, facts.width_px - 1, facts.height_px - 1)
    for name, column, last in zip(CORRECTION, rows.T, lasts, strict=True):
        whole = name in ("frame", "point")
        wrong = (whole & (column % 1 != 0)) | (column < (name == "point")) | (column > last)
        if wrong.any():
            line, first = table.lines[int(np.argmax(wrong))], int(name == "point")
            raise StrandcastError(
                "SC-I013",
                f"line {line} has {name} {column[int(np.argmax(wrong))]:g}, the film has {first} to {last}",
                file=path,
                field=name,
                fix="correct the line" + ("; the held end, point 0, is given by --held" if first else ""),
            )
    return rows
