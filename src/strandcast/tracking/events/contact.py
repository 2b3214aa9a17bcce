"""The tip's contact with the target: from their outlines, and from the effects of a blow."""

from typing import NamedTuple

import cv2
import numpy as np

from strandcast.camera.mapping import metre_per_pixel, metre_to_pixel
from strandcast.records.camera import Camera
from strandcast.records.track import Contact, DetectedTarget
from strandcast.tracking.background import Samples

NEIGHBOURS = 4  # frames before and after, from which a velocity is computed
USUAL_FRAMES = 40  # before and after, with which a change of velocity is compared
TURN_TIMES = 6.0  # the usual change of the tip's velocity, exceeded by a blow
CHANGE_TIMES = 6.0  # the noise, exceeded by a change of the target's image
LEAST_CHANGE = 8.0  # grey levels
CHANGED_SHARE = 0.08  # of the target's image
LEAST_PICTURES = 3  # before and after


class TipPath(NamedTuple):
    """The tip's path on the camera's clock, and its radius: half the string's width, or its bead's radius."""

    time_s: np.ndarray  # (F,)
    place_m: np.ndarray  # (F, 2)
    measured: np.ndarray  # (F,)
    radius_m: float


def detect_contact(
    tip: TipPath, target: DetectedTarget | None, camera: Camera, samples: Samples
) -> Contact | None:
    """Return the tip's first contact with a detected target, with all evidence for it; None if there is none.

    `samples` are grey frames (H, W) spread over the video.
    """
    if target is None:
        return None
    place_m = np.array(target.place_m)
    contact = find_contact(tip, place_m, target.radius_m)
    if contact is None:
        return None
    middle_px = metre_to_pixel(camera, place_m, camera.string_offset_m)
    radius_px = target.radius_m / float(metre_per_pixel(camera, place_m, camera.string_offset_m))
    if target_changed(samples.pictures, np.asarray(samples.indices), contact.frame, middle_px, radius_px):
        return contact.model_copy(update={"evidence": [*contact.evidence, "target"]})
    return contact


def find_contact(tip: TipPath, target_m: np.ndarray, target_radius_m: float) -> Contact | None:
    """Return the first contact of the tip with the target; None where their outlines never touch.

    Outlines that overlap in the image touch only if both lie in the plane of the throw. A change of the tip's
    velocity that is much larger than those around that time is evidence for a blow.
    """
    frames = np.flatnonzero(tip.measured & np.isfinite(tip.place_m).all(axis=1))
    if len(frames) < 2:
        return None
    distance, reach_m = np.linalg.norm(tip.place_m[frames] - target_m, axis=1), target_radius_m + tip.radius_m
    touching = distance < reach_m
    if not touching.any():
        return None
    first = int(np.argmax(touching))
    rest = np.flatnonzero(~touching[first:])
    last = first + int(rest[0]) - 1 if len(rest) else len(frames) - 1
    crossed_s = tip.time_s[frames[first]]
    if first and frames[first] - frames[first - 1] == 1:
        over = np.array([distance[first], distance[first - 1]]) - reach_m
        crossed_s -= over[0] / (over[0] - over[1]) * (crossed_s - tip.time_s[frames[first - 1]])
    place_m = np.where(tip.measured[:, None], tip.place_m, np.nan)
    struck = is_struck(tip.time_s, place_m, frames[first], frames[last])
    return Contact(
        frame=int(frames[first]),
        camera_time_s=float(crossed_s),
        distance_m=float(distance[first : last + 1].min()),
        evidence=["outlines", "tip"] if struck else ["outlines"],
    )


def is_struck(time_s: np.ndarray, tip_m: np.ndarray, first: int, last: int) -> bool:
    """Return whether the tip's velocity (F, 2) changes more from `first` to `last` than before and after."""
    change = velocity_changes(time_s, tip_m)
    begin = max(0, first - USUAL_FRAMES)
    during = change[max(0, first - 1) : last + 2]
    around = change[begin : last + 1 + USUAL_FRAMES].copy()
    around[first - begin :][: last + 1 - first + 2 * NEIGHBOURS] = np.nan
    around[: first - begin][-2 * NEIGHBOURS :] = np.nan
    if np.isfinite(around).sum() < USUAL_FRAMES // 2 or not np.isfinite(during).any():
        return False
    return bool(
        np.nanmax(during) > TURN_TIMES * np.nanmedian(around) and np.nanmax(during) > np.nanmax(around)
    )


def velocity_changes(time_s: np.ndarray, tip_m: np.ndarray) -> np.ndarray:
    """Return the change (F,) [m/s] of the tip's velocity at each frame; NaN at gaps."""
    change = np.full(len(tip_m), np.nan)
    for k in range(NEIGHBOURS, len(tip_m) - NEIGHBOURS):
        before, after = slice(k - NEIGHBOURS, k + 1), slice(k, k + NEIGHBOURS + 1)
        if np.isfinite(tip_m[before]).all() and np.isfinite(tip_m[after]).all():
            old, new = (np.polyfit(time_s[part] - time_s[k], tip_m[part], 1)[0] for part in (before, after))
            change[k] = np.hypot(*(new - old))
    return change


def target_changed(
    pictures: list[np.ndarray],
    frames: np.ndarray,
    contact_frame: int,
    middle_px: np.ndarray,
    radius_px: float,
) -> bool:
    """Return whether the target looks different after the contact: it moved, fell or turned.

    Compares each pixel's medians before and after, over whole grey frames (K of H, W) with numbers (K,): arm
    and string pass in less than half of them.
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
