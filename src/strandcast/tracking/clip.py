"""The throw for its page: frames, cropped to what the string sweeps, as a small video and a film strip."""

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from strandcast.camera.mapping import metre_to_pixel
from strandcast.camera.markers import eight_bit
from strandcast.records.camera import Camera
from strandcast.records.clip import PLAYED_HZ
from strandcast.records.manifest import VideoFacts
from strandcast.records.track import Track
from strandcast.records.verdict import AFTER_MOTION_S
from strandcast.tracking.preconditions import open_ingested
from strandcast.tracking.strobe import INSTANTS, choose_instants, moving_frames
from strandcast.video.small import small_video

# Chosen.
LARGEST_PX = 512  # the longer side of the small video
MARGIN_PX = 40  # around all measured points, in the camera's frames
MOST_FRAMES = 1500
MOST_BYTES = 300_000
STRIP_PX = 400  # the longer side of a picture of the film strip
WEBP_QUALITY = 60


def make_clip(
    video: Path,
    facts: VideoFacts,
    track: Track,
    camera: Camera,
    target_m: np.ndarray | None,
    frames: tuple[int, int] | None = None,
) -> dict[str, Any]:
    """Return the fields of a `Clip`: from the first to the last of the frames.

    By default, the throw until its miss no longer counts.

    Raises
    ------
    StrandcastError
        SC-V005 the video changed since it was ingested; others of `open_video`.
    """
    first, last = frames or throw_frames(track, facts)
    step = -(-(last - first + 1) // MOST_FRAMES)
    chosen = np.arange(first, last + 1, step)
    left, top, width, height = swept_box_px(track, camera, target_m, (first, last))
    size = even_size(width, height, LARGEST_PX)
    wanted = strip_frames(track, chosen, target_m)
    strip: list[dict[str, Any]] = []

    def pictures() -> Iterator[np.ndarray]:
        with open_ingested(video, facts) as opened:
            for index, _, image in opened:
                if index > chosen[-1]:
                    return
                if index < first or (index - first) % step:
                    continue
                crop = eight_bit(image[top : top + height, left : left + width])
                if index in wanted:
                    strip.append({"frame": int(index), "webp": _webp(crop)})
                yield _resized(crop, size)

    mp4 = small_video(
        pictures(),
        width_px=size[0],
        height_px=size[1],
        count=len(chosen),
        rate_hz=PLAYED_HZ,
        most_bytes=MOST_BYTES,
    )
    return {
        "rate_hz": facts.frame_rate_hz,
        "first_frame": int(first),
        "step": step,
        "frames": len(chosen),
        "box_px": (left, top, width, height),
        "width_px": size[0],
        "height_px": size[1],
        "mp4": base64.b64encode(mp4).decode(),
        "strip": strip,
    }


def throw_frames(track: Track, facts: VideoFacts) -> tuple[int, int]:
    """Return the first and last frame of the throw: while the hand moves, and until the miss is decided."""
    first, last = moving_frames(track.points_m[:, 0])
    after = int(track.frame[last]) + round(AFTER_MOTION_S * facts.frame_rate_hz)
    return int(track.frame[first]), min(after, facts.packets - 1)


def swept_box_px(
    track: Track, camera: Camera, target_m: np.ndarray | None, frames: tuple[int, int]
) -> tuple[int, int, int, int]:
    """Return left, top, width and height of the part of the picture that string and target, if any, need."""
    inside = (track.frame >= frames[0]) & (track.frame <= frames[1])
    places_m = track.points_m[inside].reshape(-1, 2)
    if target_m is not None:
        places_m = np.vstack([places_m, np.reshape(target_m, (-1, 2))])
    known = places_m[np.isfinite(places_m).all(axis=1)]
    whole = np.array([camera.lens.width_px, camera.lens.height_px])
    pixels = metre_to_pixel(camera, known, camera.string_offset_m)
    low = np.clip(np.floor(pixels.min(axis=0)) - MARGIN_PX, 0, whole - 2 * MARGIN_PX).astype(int)
    high = np.clip(np.ceil(pixels.max(axis=0)) + MARGIN_PX, low + 2 * MARGIN_PX, whole).astype(int)
    width, height = high - low
    return int(low[0]), int(low[1]), int(width), int(height)


def even_size(width: int, height: int, largest: int) -> tuple[int, int]:
    """Return width and height in the same proportion, even, with no side longer than `largest`."""
    share = min(1.0, largest / max(width, height))
    return max(2, 2 * round(share * width / 2)), max(2, 2 * round(share * height / 2))


def strip_frames(track: Track, chosen: np.ndarray, target_m: np.ndarray | None) -> set[int]:
    """Return the frames of the film strip: even along the tip's path, with that nearest to the target.

    They are even in time if the tip was never seen.
    """
    rows = np.flatnonzero(np.isin(track.frame, chosen))
    seen = np.isfinite(track.points_m[rows, -1]).all(axis=1)
    if not seen.any():
        return set(chosen[np.linspace(0, len(chosen) - 1, INSTANTS).astype(int)].tolist())
    instants = choose_instants(rows, track.points_m)
    if target_m is not None:
        nearest = rows[np.nanargmin(np.linalg.norm(track.points_m[rows, -1] - target_m, axis=1))]
        instants[np.abs(instants - nearest).argmin()] = nearest
    return set(track.frame[instants].tolist())


def _resized(crop: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return a crop of another size: means of whole pixels, then linear, in a fifth of the time of areas."""
    factor = max(1, min(crop.shape[1] // size[0], crop.shape[0] // size[1]))
    if factor > 1:
        whole = (crop.shape[1] // factor, crop.shape[0] // factor)
        crop = cv2.resize(crop[: whole[1] * factor, : whole[0] * factor], whole, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(crop, size, interpolation=cv2.INTER_LINEAR_EXACT))


def _webp(crop: np.ndarray) -> str:
    small = _resized(crop, even_size(crop.shape[1], crop.shape[0], STRIP_PX))
    _, data = cv2.imencode(".webp", small, [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY])
    return base64.b64encode(data.tobytes()).decode()
