"""The throw in one picture: a dozen frames over the empty scene, with the tracked points."""

import cv2
import numpy as np

from strandcast.camera.mapping import metre_to_pixel
from strandcast.camera.markers import eight_bit
from strandcast.records.camera import Camera
from strandcast.records.verdict import AFTER_MOTION_S
from strandcast.tracking.crops import Crops

INSTANTS = 12  # chosen
MOVED_M = 0.005  # chosen: from its first or last place, beyond which the hand is in motion
AFTER_SHARE = 0.15  # chosen: of the motion's duration, shown after its end


def choose_instants(candidates: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Return those of the candidate frames (K,) that spread evenly along the tip's path during the throw.

    `points_m` is the track (F, n + 1, 2). The throw lasts while the hand moves and a little longer.
    """
    first, last = moving_frames(points_m[:, 0])
    tips = np.flatnonzero(np.isfinite(points_m[:, -1]).all(axis=1))
    tips = tips[(tips >= first) & (tips <= last)]
    chosen = candidates[np.isin(candidates, tips)]
    if len(chosen) <= INSTANTS:
        return chosen
    steps = np.linalg.norm(np.diff(points_m[tips, -1], axis=0), axis=1)
    path_m = np.interp(chosen, tips, np.concatenate([[0.0], np.cumsum(steps)]))
    wanted = np.linspace(path_m[0], path_m[-1], INSTANTS)
    return np.unique(chosen[np.abs(path_m[:, None] - wanted).argmin(axis=0)])


def closest_frame(
    time_s: np.ndarray, points_m: np.ndarray, sure: np.ndarray, target_m: np.ndarray
) -> int | None:
    """Return the frame of the throw in which the tip is nearest to the target; None if it is never detected.

    `points_m` is the track (F, n + 1, 2), `sure` (F,) says which tips are measured without a flag. As for the
    verdict, a throw counts until `AFTER_MOTION_S` after the hand's motion, here as the camera shows it.
    """
    first, last = moving_frames(points_m[:, 0], after_share=0.0)
    counts = sure & (time_s >= time_s[first]) & (time_s <= time_s[last] + AFTER_MOTION_S)
    distance_m = np.where(counts, np.linalg.norm(points_m[:, -1] - target_m, axis=1), np.nan)
    return int(np.nanargmin(distance_m)) if np.isfinite(distance_m).any() else None


def with_instant(instants: np.ndarray, frame: int | None) -> np.ndarray:
    """Return the instants with the nearest one replaced by a frame."""
    if frame is None or not len(instants):
        return instants
    replaced = instants.copy()
    replaced[np.abs(instants - frame).argmin()] = frame
    return np.unique(replaced)


def frame_picture(
    index: int, sampled: np.ndarray, pictures: list[np.ndarray], crops: Crops, background: np.ndarray
) -> np.ndarray:
    """Return a frame (height, width): as it was sampled, or its crop over the empty scene."""
    row = int(np.searchsorted(sampled, index))
    if row < len(sampled) and sampled[row] == index:
        return pictures[row]
    picture, crop = background.copy(), crops.at(index)
    if crop is not None:
        pixels, left, top = crop
        picture[top : top + pixels.shape[0], left : left + pixels.shape[1]] = pixels
    return picture


def moving_frames(hand_m: np.ndarray, after_share: float = AFTER_SHARE) -> tuple[int, int]:
    """Return the first and the last frame of the hand's motion (F, 2), or of the video if it is still.

    The last one lies after the motion's end by a share of its duration, as far as there are frames.
    """
    known = np.flatnonzero(np.isfinite(hand_m).all(axis=1))
    if not len(known):
        return 0, len(hand_m) - 1
    left = known[np.linalg.norm(hand_m[known] - hand_m[known[0]], axis=1) > MOVED_M]
    coming = known[np.linalg.norm(hand_m[known] - hand_m[known[-1]], axis=1) > MOVED_M]
    if not len(left) or not len(coming):
        return 0, len(hand_m) - 1
    after = int(coming[-1] + after_share * (coming[-1] - left[0]))
    return int(left[0]), min(after, len(hand_m) - 1)


def strobe_picture(
    background: np.ndarray, pictures: list[np.ndarray], points_m: np.ndarray, camera: Camera
) -> np.ndarray:
    """Return the composite (height, width, 3), RGB, with the string's points (K, n + 1, 2) drawn in.

    Each pixel shows the grey frame in which it differs most from the empty scene.
    """
    grey = background.copy()
    most = np.zeros_like(grey)
    for now in pictures:
        change = cv2.absdiff(now, background)
        cv2.copyTo(now, cv2.compare(change, most, cv2.CMP_GT), grey)
        most = cv2.max(most, change)
    picture: np.ndarray = cv2.cvtColor(eight_bit(grey), cv2.COLOR_GRAY2RGB)
    for turn, string_m in enumerate(points_m):
        pixels = metre_to_pixel(camera, string_m, camera.string_offset_m)
        draw_points(picture, pixels, turn / max(1, len(points_m) - 1))
    return picture


def draw_points(picture: np.ndarray, points_px: np.ndarray, share: float) -> None:
    """Draw the string's points (n + 1, 2) and the lines between them, from blue (first) to orange (last)."""
    first, last = np.array([70, 120, 220]), np.array([240, 140, 40])
    colour = tuple(int(c) for c in first + share * (last - first))
    good = np.isfinite(points_px).all(axis=1)
    fixed = np.where(good[:, None], np.rint(np.nan_to_num(points_px) * 16), 0).astype(np.int32)
    for i in range(len(fixed)):
        if good[i] and i + 1 < len(fixed) and good[i + 1]:
            cv2.line(picture, fixed[i].tolist(), fixed[i + 1].tolist(), colour, 1, cv2.LINE_AA, 4)
        if good[i]:
            radius = 3 if i in (0, len(fixed) - 1) else 2
            cv2.circle(picture, fixed[i].tolist(), radius * 16, colour, -1, cv2.LINE_AA, 4)
