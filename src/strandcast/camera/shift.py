"""Detection of camera movement from the scene itself, where no marker of the plane shows it."""

import numpy as np
from skimage.registration import phase_cross_correlation

from strandcast.camera.movement import SIGNIFICANT, CameraMovement, fit_movement, movement_text
from strandcast.records.camera import Camera

DOWN, ACROSS = 3, 4  # chosen: parts of the picture, each compared alone
LEAST_PARTS = 7  # chosen: more than half; in the others the arm moves, or there is nothing to compare
UPSAMPLED = 20  # parts of a pixel to which a shift is resolved
WARNING_PX = 0.5  # chosen: films of a still camera give 0.014 px at most


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
    if moved is None or moved.displacement_px < WARNING_PX or moved.significance < SIGNIFICANT:
        return []
    return [": ".join(filter(None, movement_text(frame, moved, since)))]
