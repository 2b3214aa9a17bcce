"""The tip meets the target: told by their outlines, and by what a blow leaves behind."""

from __future__ import annotations

import cv2
import numpy as np

from strandcast.camera.mapping import metre_per_pixel, metre_to_pixel
from strandcast.records.camera import Camera
from strandcast.records.track import Contact, SeenTarget

NEIGHBOURS = 4  # frames before and after, that a speed is taken from
USUAL_FRAMES = 40  # before and after, that a change of speed is compared with
TURN_TIMES = 6.0  # the usual change of the tip's velocity, that a blow exceeds
CHANGE_TIMES = 6.0  # the noise, that the target's picture must have changed by
LEAST_CHANGE = 8.0  # grey levels
CHANGED_SHARE = 0.08  # of the target's picture
LEAST_PICTURES = 3  # before and after


def notice_contact(
    time_s: np.ndarray,
    tip_m: np.ndarray,
    seen: np.ndarray,
    tip_radius_m: float,
    target: SeenTarget | None,
    camera: Camera,
    pictures: list[np.ndarray],
    frames: np.ndarray,
) -> Contact | None:
    """Return the tip's first contact with the target that is seen, with all that speaks for it.

    Parameters
    ----------
    time_s, tip_m, seen, tip_radius_m
        As `find_contact` takes them.
    target
        As `locate_target` found it; of a target that is not seen, no contact is told.
    camera
        Where the target is in the picture.
    pictures, frames
        Whole grey frames (K of H, W) spread over the video, and their numbers (K,).
    """
    if target is None:
        return None
    place_m = np.array(target.place_m)
    contact = find_contact(time_s, tip_m, seen, place_m, target.radius_m, tip_radius_m)
    if contact is None:
        return None
    middle_px = metre_to_pixel(camera, place_m, camera.string_offset_m)
    radius_px = target.radius_m / float(metre_per_pixel(camera, place_m, camera.string_offset_m))
    if target_changed(pictures, frames, contact.frame, middle_px, radius_px):
        return contact.model_copy(update={"evidence": [*contact.evidence, "target"]})
    return contact


def find_contact(
    time_s: np.ndarray,
    tip_m: np.ndarray,
    seen: np.ndarray,
    target_m: np.ndarray,
    target_radius_m: float,
    tip_radius_m: float,
) -> Contact | None:
    """Return the first contact of the tip with the target; None where their outlines never touch.

    Parameters
    ----------
    time_s, tip_m, seen
        Camera time (F,), the tip (F, 2) and whether it was measured (F,).
    target_m, target_radius_m
        Where the target is seen, and how large.
    tip_radius_m
        Of the tip: half the string's width, or the ball's radius.

    Notes
    -----
    Outlines that overlap in the picture touch only if both lie in the plane of the throw. A sudden change of
    the tip's velocity, larger than what it goes through around that time, speaks for a blow.
    """
    frames = np.flatnonzero(seen & np.isfinite(tip_m).all(axis=1))
    if len(frames) < 2:
        return None
    distance = np.linalg.norm(tip_m[frames] - target_m, axis=1)
    touching = distance < target_radius_m + tip_radius_m
    if not touching.any():
        return None
    first = int(np.argmax(touching))
    rest = np.flatnonzero(~touching[first:])
    last = first + int(rest[0]) - 1 if len(rest) else len(frames) - 1
    crossed_s = time_s[frames[first]]
    if first and frames[first] - frames[first - 1] == 1:
        over = np.array([distance[first], distance[first - 1]]) - (target_radius_m + tip_radius_m)
        crossed_s -= over[0] / (over[0] - over[1]) * (time_s[frames[first]] - time_s[frames[first - 1]])
    evidence = ["outlines"]
    if is_struck(time_s, np.where(seen[:, None], tip_m, np.nan), frames[first], frames[last]):
        evidence.append("tip")
    return Contact(
        frame=int(frames[first]), camera_time_s=float(crossed_s),
        distance_m=float(distance[first : last + 1].min()), evidence=evidence,
    )  # fmt: skip


def is_struck(time_s: np.ndarray, tip_m: np.ndarray, first: int, last: int) -> bool:
    """Tell whether the tip's velocity (F, 2) jumps between two frames as it does not before and after."""
    change = velocity_changes(time_s, tip_m)
    during = change[max(0, first - 1) : last + 2]
    around = change[max(0, first - USUAL_FRAMES) : last + 1 + USUAL_FRAMES].copy()
    inside = slice(first - max(0, first - USUAL_FRAMES), None)
    around[inside][: last + 1 - first + 2 * NEIGHBOURS] = np.nan
    around[: max(0, first - max(0, first - USUAL_FRAMES))][-2 * NEIGHBOURS :] = np.nan
    if np.isfinite(around).sum() < USUAL_FRAMES // 2 or not np.isfinite(during).any():
        return False
    return bool(
        np.nanmax(during) > TURN_TIMES * np.nanmedian(around) and np.nanmax(during) > np.nanmax(around)
    )


def velocity_changes(time_s: np.ndarray, tip_m: np.ndarray) -> np.ndarray:
    """Return by how much (F,) [m/s] the tip's velocity changes at each frame; NaN at gaps."""
    change = np.full(len(tip_m), np.nan)
    for k in range(NEIGHBOURS, len(tip_m) - NEIGHBOURS):
        part = slice(k - NEIGHBOURS, k + NEIGHBOURS + 1)
        if np.isfinite(tip_m[part]).all():
            before = np.polyfit(time_s[k - NEIGHBOURS : k + 1] - time_s[k], tip_m[k - NEIGHBOURS : k + 1], 1)[
                0
            ]
            after = np.polyfit(time_s[k : k + NEIGHBOURS + 1] - time_s[k], tip_m[k : k + NEIGHBOURS + 1], 1)[
                0
            ]
            change[k] = np.hypot(*(after - before))
    return change


def target_changed(
    pictures: list[np.ndarray],
    frames: np.ndarray,
    contact_frame: int,
    middle_px: np.ndarray,
    radius_px: float,
) -> bool:
    """Tell whether the target looks otherwise after the contact than before: it moved, fell or turned.

    Parameters
    ----------
    pictures, frames
        Whole grey frames of the throw and their numbers (K,), in order.
    contact_frame
        Of the contact.
    middle_px, radius_px
        The target in the picture.

    Notes
    -----
    Of each pixel the median before is compared with that after: arm and string pass in less than half of the
    pictures.
    """
    reach = int(np.ceil(1.5 * radius_px)) + 1
    u, v = np.rint(middle_px).astype(int)
    window = slice(max(0, v - reach), v + reach + 1), slice(max(0, u - reach), u + reach + 1)
    parts = [picture[window].astype(np.float32) for picture in pictures]
    before = [part for part, frame in zip(parts, frames, strict=True) if frame < contact_frame]
    after = [part for part, frame in zip(parts, frames, strict=True) if frame > contact_frame]
    if min(len(before), len(after)) < LEAST_PICTURES or min(parts[0].shape) < 3:
        return False
    was = np.median(before, axis=0)
    change = np.abs(cv2.blur(np.median(after, axis=0) - was, (3, 3)))
    noise = 1.48 * float(np.median([np.median(np.abs(part - was)) for part in before]))
    return bool((change > max(CHANGE_TIMES * noise, LEAST_CHANGE)).mean() > CHANGED_SHARE)
