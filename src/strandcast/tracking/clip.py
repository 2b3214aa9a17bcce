"""The throw for its page: frames, cropped to what the string sweeps, as a small video and a film strip."""

import base64
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np

from strandcast.camera.mapping import metre_to_pixel
from strandcast.camera.markers import eight_bit
from strandcast.records.camera import Camera
from strandcast.records.clip import PLAYED_HZ
from strandcast.records.manifest import VideoFacts
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


class Frames(Protocol):
    """The frames of a video, smaller by a whole factor."""

    @property
    def factor(self) -> int:
        """How many of the camera's pixels are one on a side."""

    def pictures(self, frames: Sequence[int]) -> Iterator[np.ndarray]:
        """Yield some frames, in rising order, grey (height, width) in the video's depth."""


class VideoFrames(NamedTuple):
    """The frames of a video that is decoded for them; SC-V005 if it changed since it was ingested."""

    video: Path
    facts: VideoFacts
    factor: int = 1

    def pictures(self, frames: Sequence[int]) -> Iterator[np.ndarray]:
        """Yield some frames, in rising order, grey (height, width) in the video's depth."""
        wanted, last = set(frames), frames[-1]
        with open_ingested(self.video, self.facts) as opened:
            for index, _, image in opened:
                if index in wanted:
                    yield image
                if index == last:
                    return


def make_clip(
    source: Frames,
    facts: VideoFacts,
    points_m: np.ndarray,
    camera: Camera,
    target_m: np.ndarray | None,
    frames: tuple[int, int] | None = None,
) -> dict[str, Any]:
    """Return the fields of a `Clip`: from the first to the last of the frames.

    By default, the throw until its miss no longer counts. `points_m` is the track (F, n + 1, 2).
    """
    first, last = frames or throw_frames(points_m, facts)
    step = -(-(last - first + 1) // MOST_FRAMES)
    chosen = np.arange(first, last + 1, step)
    left, top, width, height = swept_box_px(points_m[first : last + 1], camera, target_m, source.factor)
    size = even_size(width, height, LARGEST_PX)
    wanted = strip_frames(points_m, chosen, target_m)
    strip: list[dict[str, Any]] = []

    def pictures() -> Iterator[np.ndarray]:
        for index, image in zip(chosen.tolist(), source.pictures(chosen.tolist()), strict=True):
            crop = eight_bit(image[top : top + height, left : left + width])
            if index in wanted:
                strip.append({"frame": index, "webp": _webp(crop)})
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
        "box_px": tuple(source.factor * each for each in (left, top, width, height)),
        "width_px": size[0],
        "height_px": size[1],
        "mp4": base64.b64encode(mp4).decode(),
        "strip": strip,
    }


def throw_frames(points_m: np.ndarray, facts: VideoFacts) -> tuple[int, int]:
    """Return the first and last frame of the throw: while the hand moves, and until the miss is decided."""
    first, last = moving_frames(points_m[:, 0])
    return first, min(last + round(AFTER_MOTION_S * facts.frame_rate_hz), len(points_m) - 1)


def swept_box_px(
    points_m: np.ndarray, camera: Camera, target_m: np.ndarray | None, factor: int
) -> tuple[int, int, int, int]:
    """Return left, top, width and height of the part of the picture that string and target, if any, need.

    `points_m` is the track (F, n + 1, 2). A pixel is one of the small frames: `factor` of the camera's wide.
    """
    places_m = points_m.reshape(-1, 2)
    if target_m is not None:
        places_m = np.vstack([places_m, np.reshape(target_m, (-1, 2))])
    known = places_m[np.isfinite(places_m).all(axis=1)]
    margin, whole = MARGIN_PX // factor, np.array([camera.lens.width_px, camera.lens.height_px]) // factor
    pixels = (metre_to_pixel(camera, known, camera.string_offset_m) + 0.5) / factor - 0.5
    low = np.clip(np.floor(pixels.min(axis=0)) - margin, 0, np.maximum(whole - 2 * margin, 0)).astype(int)
    high = np.clip(np.ceil(pixels.max(axis=0)) + margin, low + 2 * margin, whole).astype(int)
    width, height = high - low
    return int(low[0]), int(low[1]), int(width), int(height)


def even_size(width: int, height: int, largest: int) -> tuple[int, int]:
    """Return width and height in the same proportion, even, with no side longer than `largest`."""
    share = min(1.0, largest / max(width, height))
    return max(2, 2 * round(share * width / 2)), max(2, 2 * round(share * height / 2))


def strip_frames(points_m: np.ndarray, chosen: np.ndarray, target_m: np.ndarray | None) -> set[int]:
    """Return the frames of the film strip: even along the tip's path, with that nearest to the target.

    They are even in time if the tip was not seen while the hand moved.
    """
    instants = choose_instants(chosen, points_m)
    if not len(instants):
        return set(chosen[np.linspace(0, len(chosen) - 1, INSTANTS).astype(int)].tolist())
    if target_m is not None:
        nearest = chosen[np.nanargmin(np.linalg.norm(points_m[chosen, -1] - target_m, axis=1))]
        instants[np.abs(instants - nearest).argmin()] = nearest
    return set(instants.tolist())


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
