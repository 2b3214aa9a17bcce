"""Whether the camera has moved since the photo of the plane: its markers in a frame of the throw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from strandcast.camera.find_markers import refine_corners
from strandcast.camera.markers import detect_markers, eight_bit, marker_cells, marker_detector
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera

ERROR_PX, WARNING_PX = 1.0, 0.2
SURE = 4.0  # standard errors
MARGIN_SIDES = 1.0  # of a marker, around the place where it was
MARKER_SIGMA_PX = 0.03  # least error of a marker's centre, in either picture
RIGID_PX = 0.7  # rms by which a marker's four corners may move unlike each other: more, and it is half hidden
APART_PX = 0.5  # from where the other markers' movement would take it: such a marker was moved itself


@dataclass(frozen=True)
class Moved:
    """The plane's markers in a frame against their photo.

    Attributes
    ----------
    displacement_px, displacement_m
        Of the picture and at the string, root mean square over the markers' places, of the shift, turn and
        zoom that fit the markers' centres best.
    sigma_px
        Its standard error; without a movement the displacement is about as large.
    shift_px, turn_rad, zoom
        The movement's parts; `shift_px` (u, v) at the middle of the markers.
    markers
        Those it was found from.
    apart_px
        Markers that moved by themselves, and by how much.
    """

    displacement_px: float
    displacement_m: float
    sigma_px: float
    shift_px: tuple[float, float]
    turn_rad: float
    zoom: float
    markers: list[int]
    apart_px: dict[int, float] = field(default_factory=dict)

    @property
    def significance(self) -> float:
        """Return the displacement over its standard error."""
        return self.displacement_px / self.sigma_px


def check_moved(camera: Camera, grey: np.ndarray) -> Moved | None:
    """Compare the plane's markers in a frame with the photo that the camera was calibrated by.

    Parameters
    ----------
    camera
        From `plane_from_markers`.
    grey
        A frame (height, width) of the throw, of the photo's size.

    Returns
    -------
    Moved or None
        None where fewer than two of the markers are seen, or the camera has none.
    """
    known = {fit.marker: np.array(fit.residuals_px)[:, :2] for fit in camera.plane_markers}
    if camera.dictionary is None or len(known) < 2:
        return None
    seen = _look_for(known, camera.dictionary, eight_bit(grey))
    ids = sorted(marker for marker in seen if _rigid(seen[marker] - known[marker]))
    if len(ids) < 2:
        return None
    before = np.array([known[marker].mean(axis=0) for marker in ids])
    after = np.array([seen[marker].mean(axis=0) for marker in ids])
    kept = _together(before, after)
    return _moved(camera, ids, before, after, kept)


def _rigid(steps_px: np.ndarray) -> bool:
    about = steps_px - steps_px.mean(axis=0)
    return bool(
        np.sqrt((about**2).sum(axis=1).mean()) < RIGID_PX + 0.05 * np.linalg.norm(steps_px.mean(axis=0))
    )


def _look_for(known: dict[int, np.ndarray], dictionary: str, grey: np.ndarray) -> dict[int, np.ndarray]:
    """Return the corners (4, 2) of the markers near their places; where most are not there, anywhere."""
    detector = marker_detector(dictionary)
    seen: dict[int, np.ndarray] = {}
    for marker, corners in known.items():
        side = np.linalg.norm(corners[1] - corners[0])
        low = np.maximum(np.floor(corners.min(axis=0) - MARGIN_SIDES * side), 0).astype(int)
        high = np.ceil(corners.max(axis=0) + MARGIN_SIDES * side).astype(int)
        crop = np.ascontiguousarray(grey[low[1] : high[1], low[0] : high[0]])
        ids, found = detect_markers(crop, detector)
        for place in np.flatnonzero(ids == marker)[:1]:
            seen[marker] = found[place] + low
    if len(seen) < max(2, len(known) // 2):
        ids, found = detect_markers(grey, detector)
        seen = {int(marker): four for marker, four in zip(ids, found, strict=True) if int(marker) in known}
    return {
        marker: refine_corners(grey, four, len(marker_cells(dictionary, marker)))
        for marker, four in seen.items()
    }


def _together(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return which markers (K,) moved with most of the others, as one picture does."""
    kept = np.ones(len(before), bool)
    while kept.sum() > 2:
        # Each left out in turn: one that was moved by itself would drag the fit towards it.
        worst, off = max(
            ((int(k), _off_others(before, after, kept, int(k))) for k in np.flatnonzero(kept)),
            key=lambda pair: pair[1],
        )
        if off < APART_PX:
            break
        kept[worst] = False
    return kept


def _off_others(before: np.ndarray, after: np.ndarray, kept: np.ndarray, left_out: int) -> float:
    others = kept & (np.arange(len(kept)) != left_out)
    numbers = _fit(before[others], after[others])[0]
    middle = before[others].mean(axis=0)
    return float(
        np.linalg.norm(after[left_out] - before[left_out] - _field(before[[left_out]] - middle, numbers))
    )


def _design(about_px: np.ndarray) -> np.ndarray:
    """Return how steps (K, 2) follow shift u, shift v, turn and zoom: (2K, 4)."""
    ones, zeros = np.ones(len(about_px)), np.zeros(len(about_px))
    u, v = about_px.T
    return np.stack([np.stack([ones, zeros, -v, u], -1), np.stack([zeros, ones, u, v], -1)], 1).reshape(-1, 4)


def _field(about_px: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    return (_design(about_px) @ numbers).reshape(-1, 2)


def _fit(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return shift, turn and zoom (4,), and their covariance, of a picture's small movement."""
    design = _design(before - before.mean(axis=0))
    steps = (after - before).ravel()
    numbers = np.linalg.lstsq(design, steps, rcond=None)[0]
    off = steps - design @ numbers
    variance = max((off**2).sum() / max(len(steps) - 4, 1), 2.0 * MARKER_SIGMA_PX**2)
    return numbers, np.linalg.pinv(design.T @ design) * variance


def _moved(camera: Camera, ids: list[int], before: np.ndarray, after: np.ndarray, kept: np.ndarray) -> Moved:
    numbers, covariance = _fit(before[kept], after[kept])
    about = before - before[kept].mean(axis=0)
    steps = _field(about, numbers)
    design = _design(about[kept])
    sigma_px = float(np.sqrt(np.trace(design @ covariance @ design.T) / kept.sum()))
    displacement_px = float(np.sqrt((steps[kept] ** 2).sum(axis=1).mean()))
    off = np.linalg.norm(after - before - steps, axis=1)
    return Moved(
        displacement_px,
        displacement_px * camera.scale_m_per_px,
        sigma_px,
        (float(numbers[0]), float(numbers[1])),
        float(numbers[2]),
        float(1.0 + numbers[3]),
        [marker for marker, good in zip(ids, kept, strict=True) if good],
        {ids[k]: float(off[k]) for k in np.flatnonzero(~kept)},
    )


def refuse_moved(seen: Sequence[tuple[int, Moved]], file: str | Path | None = None) -> list[str]:
    """Say whether the camera stood still, by what `check_moved` found in some frames.

    Parameters
    ----------
    seen
        (frame, what was found there).
    file
        The video, for messages.

    Returns
    -------
    list of str
        Warnings: the camera moved by less than a pixel, or one marker was moved.

    Raises
    ------
    StrandcastError
        SC-C040: by more than a pixel.
    """
    sure = [(frame, moved) for frame, moved in seen if moved.significance > SURE]
    warnings = _apart_warnings(seen)
    if not sure:
        return warnings
    frame, most = max(sure, key=lambda pair: pair[1].displacement_px)
    what = (
        f"the camera has moved since the photo of the plane: {most.displacement_px:.2f} ± "
        f"{most.sigma_px:.2f} px at frame {frame} ({most.shift_px[0]:+.2f}, {most.shift_px[1]:+.2f} px, turn "
        f"{np.degrees(most.turn_rad):+.3f} degrees, zoom {most.zoom - 1.0:+.3%})"
    )
    cost = f"{most.displacement_m * 1e3:.1f} mm at the string"
    if most.displacement_px > ERROR_PX:
        raise StrandcastError(
            "SC-C040",
            what,
            file=file,
            line=frame,
            cost=cost,
            fix="photograph the plane again where the camera stands now, or exclude the trial",
        )
    return warnings + ([f"{what}: {cost}"] if most.displacement_px > WARNING_PX else [])


def _apart_warnings(seen: Sequence[tuple[int, Moved]]) -> list[str]:
    """Tell of markers that were moved by themselves, as most of the frames show them."""
    told = []
    for marker in sorted({marker for _, moved in seen for marker in moved.apart_px}):
        off = [moved.apart_px[marker] for _, moved in seen if marker in moved.apart_px]
        shown = sum(marker in moved.markers or marker in moved.apart_px for _, moved in seen)
        if len(off) > shown / 2:
            told.append(
                f"marker {marker} was moved since the photo of the plane, by {np.median(off):.1f} px; the "
                "others were not"
            )
    return told
