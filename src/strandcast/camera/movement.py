"""Detection of camera movement: from the plane's markers in a frame, or from the scene itself."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from skimage.measure import ransac
from skimage.registration import phase_cross_correlation
from skimage.transform import SimilarityTransform

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
PERSPECTIVE_SHARE = 0.05  # chosen: of the movement, by which it differs between corners of the picture
PAIRS = 100  # chosen: of markers, tried in turn; more than the 28 of 8 markers
# Of the scene, where no marker of the plane shows the movement.
DOWN, ACROSS = 3, 4  # chosen: parts of the picture, each compared alone
LEAST_PARTS = 7  # chosen: more than half; in the others the arm moves, or there is nothing to compare
UPSAMPLED = 20  # parts of a pixel to which a shift is resolved
SHIFT_WARNING_PX = 0.5  # chosen: films of a still camera give 0.014 px at most


@dataclass(frozen=True)
class CameraMovement:
    """The shift, rotation and zoom of the plane's markers in a frame relative to their photo."""

    displacement_px: float  # root mean square over the markers' centres, as fitted
    displacement_m: float  # the same at the string
    sigma_px: float  # its standard error; without movement the displacement is about as large
    shift_px: tuple[float, float]  # (u, v) at the centre of the markers
    rotation_rad: float
    zoom: float
    markers: list[int]  # used in the fit
    own_movement_px: dict[int, float] = field(default_factory=dict)  # of markers that moved by themselves

    @property
    def significance(self) -> float:
        """Return the displacement over its standard error."""
        return self.displacement_px / self.sigma_px


def find_movement(camera: Camera, grey: np.ndarray) -> CameraMovement | None:
    """Compare the plane's markers in a frame with the photo used for calibration.

    The frame (height, width) is as large as that photo. None if fewer than two of the markers are detected
    or the camera has none.
    """
    known = {fit.marker: np.array(fit.residuals_px)[:, :2] for fit in camera.plane_markers}
    if camera.dictionary is None or len(known) < 2:
        return None
    detected = _detect_near(known, camera.dictionary, eight_bit(grey))
    ids = sorted(marker for marker in detected if _is_rigid(detected[marker] - known[marker]))
    if len(ids) < 2:
        return None
    return fit_movement(
        camera, ids, *(np.array([at[k].mean(axis=0) for k in ids]) for at in (known, detected))
    )


def _is_rigid(steps_px: np.ndarray) -> bool:
    mean_px = steps_px.mean(axis=0)
    return bool(rms(steps_px - mean_px) < RIGID_PX + PERSPECTIVE_SHARE * np.linalg.norm(mean_px))


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


def fit_movement(camera: Camera, ids: list[int], before: np.ndarray, after: np.ndarray) -> CameraMovement:
    """Fit shift, rotation and zoom to the centres (K, 2) of the largest group of markers that moved as one.

    Markers outside that group moved by themselves: they would distort a fit to all.
    """
    moved_px = float(np.median(np.linalg.norm(after - before, axis=1)))
    apart_px = OWN_MOVEMENT_PX + PERSPECTIVE_SHARE * moved_px
    model, kept = ransac((before, after), SimilarityTransform, 2, apart_px, max_trials=PAIRS, rng=0)
    off = model.residuals(before, after)
    steps = model(before)[kept] - before[kept]
    # Four numbers are fitted to two coordinates of each marker.
    square = (off[kept] ** 2).sum() / max(2 * kept.sum() - 4, 1)
    variance = max(float(square), 2.0 * MARKER_SIGMA_PX**2)
    displacement_px, (shift_u, shift_v) = rms(steps), steps.mean(axis=0)
    return CameraMovement(
        displacement_px,
        displacement_px * camera.scale_m_per_px,
        float(np.sqrt(4.0 * variance / kept.sum())),
        (float(shift_u), float(shift_v)),
        float(model.rotation),
        float(model.scale),
        [marker for marker, good in zip(ids, kept, strict=True) if good],
        {ids[k]: float(off[k]) for k in np.flatnonzero(~kept)},
    )


def check_movement(
    movements: Sequence[tuple[int, CameraMovement]], file: str | Path | None = None
) -> list[str]:
    """Check that the camera did not move; return warnings: it moved by less than a pixel, or a marker moved.

    `movements` are numbers of frames with the results of `find_movement`; `file` is the video.

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
    what, cost = movement_text(frame, most, "the photo of the plane")
    if most.displacement_px > ERROR_PX:
        raise StrandcastError("SC-C040", what, file=file, line=frame, cost=cost)
    return warnings + ([f"{what}: {cost}"] if most.displacement_px > WARNING_PX else [])


def movement_text(frame: int, moved: CameraMovement, since: str) -> tuple[str, str]:
    """Return the words for a movement of the camera since an earlier picture, and its cost, if known."""
    return (
        f"the camera has moved since {since}: {moved.displacement_px:.2f} ± "
        f"{moved.sigma_px:.2f} px at frame {frame} ({moved.shift_px[0]:+.2f}, {moved.shift_px[1]:+.2f} px, "
        f"rotation {np.degrees(moved.rotation_rad):+.3f} degrees, zoom {moved.zoom - 1.0:+.3%})",
        f"{moved.displacement_m * 1e3:.1f} mm at the string" if moved.displacement_m > 0 else "",
    )


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


def find_shift(camera: Camera, before: np.ndarray, after: np.ndarray) -> CameraMovement | None:
    """Compare two pictures of one scene, part by part.

    The grey pictures (height, width) are medians over frames: noise that two frames share, as some sensors'
    and coders', would count as texture. `markers` of the result are numbers of parts. None if less than half
    of the parts moved as one: the scene has too little texture, or too much of it moves.
    """
    height, width = before.shape[0] // DOWN, before.shape[1] // ACROSS
    taper = np.outer(np.hanning(height), np.hanning(width))
    corners = [(row * height, column * width) for row in range(DOWN) for column in range(ACROSS)]
    steps = []
    for top, left in corners:
        part = np.s_[top : top + height, left : left + width]
        now, then = (taper * (picture[part] - picture[part].mean()) for picture in (after, before))
        # Without the normalisation: it weighs all frequencies alike, and most hold noise only.
        shift = phase_cross_correlation(now, then, upsample_factor=UPSAMPLED, normalization=None)[0]
        steps.append(shift[::-1])
    middles = np.array(corners)[:, ::-1] + 0.5 * np.array([width, height])
    moved = fit_movement(camera, list(range(len(corners))), middles, middles + np.array(steps))
    return moved if len(moved.markers) >= LEAST_PARTS else None


def shift_warnings(
    camera: Camera, before: np.ndarray, after: np.ndarray, frame: int, since: str
) -> list[str]:
    """Return a warning if the camera moved between two pictures: the first is `since`, the second `frame`."""
    moved = find_shift(camera, before, after)
    if moved is None or moved.displacement_px < SHIFT_WARNING_PX or moved.significance < SIGNIFICANT:
        return []
    return [": ".join(filter(None, movement_text(frame, moved, since)))]
