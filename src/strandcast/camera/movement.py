"""Detection of camera movement since the photo of the plane, from the plane's markers in a frame."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from strandcast.camera.find_markers import refine_corners
from strandcast.camera.markers import detect_markers, eight_bit, marker_cells, marker_detector
from strandcast.camera.pose import rms
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera

ERROR_PX, WARNING_PX = 1.0, 0.2  # chosen
SIGNIFICANT = 4.0  # chosen: standard errors
MARGIN_SIDES = 1.0  # chosen: search margin around a marker's former place, in sides of the marker
MARKER_SIGMA_PX = 0.03  # chosen: lower bound of the error of a marker's centre
RIGID_PX = 0.7  # chosen: largest rms of corner displacements about their mean; above, the marker is occluded
OWN_MOVEMENT_PX = 0.5  # chosen: deviation from the others' movement above which a marker itself moved


@dataclass(frozen=True)
class CameraMovement:
    """The displacement of the plane's markers in a frame relative to their photo.

    Attributes
    ----------
    displacement_px, displacement_m
        Root mean square displacement over the markers, in the picture and at the string, of the shift,
        rotation and zoom fitted to the markers' centres.
    sigma_px
        Its standard error; without movement the displacement is about as large.
    shift_px, rotation_rad, zoom
        Components of the movement; `shift_px` (u, v) at the centre of the markers.
    markers
        Markers used in the fit.
    own_movement_px
        Displacements of markers that moved relative to the others.
    """

    displacement_px: float
    displacement_m: float
    sigma_px: float
    shift_px: tuple[float, float]
    rotation_rad: float
    zoom: float
    markers: list[int]
    own_movement_px: dict[int, float] = field(default_factory=dict)

    @property
    def significance(self) -> float:
        """Return the displacement over its standard error."""
        return self.displacement_px / self.sigma_px


def find_movement(camera: Camera, grey: np.ndarray) -> CameraMovement | None:
    """Compare the plane's markers in a frame with the photo used for calibration.

    Parameters
    ----------
    camera
        From `plane_from_markers`.
    grey
        A frame (height, width) of the throw, as large as the photo.

    Returns
    -------
    CameraMovement or None
        None if fewer than two of the markers are detected or the camera has none.
    """
    known = {fit.marker: np.array(fit.residuals_px)[:, :2] for fit in camera.plane_markers}
    if camera.dictionary is None or len(known) < 2:
        return None
    detected = _detect_near(known, camera.dictionary, eight_bit(grey))
    ids = sorted(marker for marker in detected if _is_rigid(detected[marker] - known[marker]))
    if len(ids) < 2:
        return None
    before = np.array([known[marker].mean(axis=0) for marker in ids])
    after = np.array([detected[marker].mean(axis=0) for marker in ids])
    kept = _moving_together(before, after)
    return _movement(camera, ids, before, after, kept)


def _is_rigid(steps_px: np.ndarray) -> bool:
    mean_px = steps_px.mean(axis=0)
    return bool(rms(steps_px - mean_px) < RIGID_PX + 0.05 * np.linalg.norm(mean_px))


def _detect_near(known: dict[int, np.ndarray], dictionary: str, grey: np.ndarray) -> dict[int, np.ndarray]:
    """Return the markers' corners (4, 2) near their former places; anywhere if most are not there."""
    detector = marker_detector(dictionary)
    detected: dict[int, np.ndarray] = {}
    for marker, corners in known.items():
        side = np.linalg.norm(corners[1] - corners[0])
        low = np.maximum(np.floor(corners.min(axis=0) - MARGIN_SIDES * side), 0).astype(int)
        high = np.ceil(corners.max(axis=0) + MARGIN_SIDES * side).astype(int)
        crop = np.ascontiguousarray(grey[low[1] : high[1], low[0] : high[0]])
        ids, found = detect_markers(crop, detector)
        for place in np.flatnonzero(ids == marker)[:1]:
            detected[marker] = found[place] + low
    if len(detected) < max(2, len(known) // 2):
        ids, found = detect_markers(grey, detector)
        detected = {int(k): four for k, four in zip(ids, found, strict=True) if int(k) in known}
    return {
        marker: refine_corners(grey, four, len(marker_cells(dictionary, marker)))
        for marker, four in detected.items()
    }


def _moving_together(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return which markers (K,) moved with most of the others, as under camera movement."""
    kept = np.ones(len(before), bool)
    while kept.sum() > 2:
        # Each left out in turn: a marker that itself moved would distort the fit.
        deviations = [(int(k), _deviation(before, after, kept, int(k))) for k in np.flatnonzero(kept)]
        worst, off = max(deviations, key=lambda pair: pair[1])
        if off < OWN_MOVEMENT_PX:
            break
        kept[worst] = False
    return kept


def _deviation(before: np.ndarray, after: np.ndarray, kept: np.ndarray, left_out: int) -> float:
    others = kept & (np.arange(len(kept)) != left_out)
    numbers = _fit(before[others], after[others])[0]
    middle = before[others].mean(axis=0)
    predicted = _displacement(before[[left_out]] - middle, numbers)
    return float(np.linalg.norm(after[left_out] - before[left_out] - predicted))


def _design(about_px: np.ndarray) -> np.ndarray:
    """Return the design matrix (2K, 4) of displacements (K, 2) by shift u, shift v, rotation and zoom."""
    ones, zeros = np.ones(len(about_px)), np.zeros(len(about_px))
    u, v = about_px.T
    return np.stack([np.stack([ones, zeros, -v, u], -1), np.stack([zeros, ones, u, v], -1)], 1).reshape(-1, 4)


def _displacement(about_px: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    return np.asarray(_design(about_px) @ numbers).reshape(-1, 2)


def _fit(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return shift, rotation and zoom (4,) of a small movement, and their covariance."""
    design = _design(before - before.mean(axis=0))
    steps = (after - before).ravel()
    numbers = np.linalg.lstsq(design, steps, rcond=None)[0]
    off = steps - design @ numbers
    variance = max((off**2).sum() / max(len(steps) - 4, 1), 2.0 * MARKER_SIGMA_PX**2)
    return numbers, np.linalg.pinv(design.T @ design) * variance


def _movement(
    camera: Camera, ids: list[int], before: np.ndarray, after: np.ndarray, kept: np.ndarray
) -> CameraMovement:
    numbers, covariance = _fit(before[kept], after[kept])
    about = before - before[kept].mean(axis=0)
    steps = _displacement(about, numbers)
    design = _design(about[kept])
    sigma_px = float(np.sqrt(np.trace(design @ covariance @ design.T) / kept.sum()))
    displacement_px = rms(steps[kept])
    off = np.linalg.norm(after - before - steps, axis=1)
    return CameraMovement(
        displacement_px,
        displacement_px * camera.scale_m_per_px,
        sigma_px,
        (float(numbers[0]), float(numbers[1])),
        float(numbers[2]),
        float(1.0 + numbers[3]),
        [marker for marker, good in zip(ids, kept, strict=True) if good],
        {ids[k]: float(off[k]) for k in np.flatnonzero(~kept)},
    )


def check_movement(
    movements: Sequence[tuple[int, CameraMovement]], file: str | Path | None = None
) -> list[str]:
    """Check that the camera did not move; return warnings: it moved by less than a pixel, or a marker moved.

    Parameters
    ----------
    movements
        Frames and the results of `find_movement` in them.
    file
        The video, for messages.

    Raises
    ------
    StrandcastError
        SC-C040 the camera moved by more than a pixel.
    """
    sure = [(frame, moved) for frame, moved in movements if moved.significance > SIGNIFICANT]
    warnings = _marker_warnings(movements)
    if not sure:
        return warnings
    frame, most = max(sure, key=lambda pair: pair[1].displacement_px)
    what = (
        f"the camera has moved since the photo of the plane: {most.displacement_px:.2f} ± "
        f"{most.sigma_px:.2f} px at frame {frame} ({most.shift_px[0]:+.2f}, {most.shift_px[1]:+.2f} px, "
        f"rotation {np.degrees(most.rotation_rad):+.3f} degrees, zoom {most.zoom - 1.0:+.3%})"
    )
    cost = f"{most.displacement_m * 1e3:.1f} mm at the string"
    if most.displacement_px > ERROR_PX:
        fix = "photograph the plane again from the camera's present position, or exclude the trial"
        raise StrandcastError("SC-C040", what, file=file, line=frame, cost=cost, fix=fix)
    return warnings + ([f"{what}: {cost}"] if most.displacement_px > WARNING_PX else [])


def _marker_warnings(movements: Sequence[tuple[int, CameraMovement]]) -> list[str]:
    """Return a warning for each marker that itself moved in most frames that show it."""
    warnings = []
    for marker in sorted({marker for _, moved in movements for marker in moved.own_movement_px}):
        off = [moved.own_movement_px[marker] for _, moved in movements if marker in moved.own_movement_px]
        shown = sum(marker in moved.markers or marker in moved.own_movement_px for _, moved in movements)
        if len(off) > shown / 2:
            warnings.append(
                f"marker {marker} has moved by {np.median(off):.1f} px since the photo of the plane; the "
                "others have not"
            )
    return warnings
