"""A small world for the tracker: a prescribed whip, drawn anti-aliased, blurred by motion, with noise.

It shares nothing with the lab: no physics, no renderer.
"""

import av
import cv2
import numpy as np

from strandcast.config.string import String
from strandcast.config.track import TrackSettings
from strandcast.core.hand_marker import HandMarker
from strandcast.records.camera import Camera, Lens
from strandcast.tracking.result import Tracked
from strandcast.tracking.track_video import track_video
from strandcast.tracking.tracker import TrackerInput
from strandcast.video.ingest import inspect_video

SCALE_M = 0.0015
WIDTH, HEIGHT = 800, 600


def flat_camera(
    width: int = WIDTH, height: int = HEIGHT, scale_m: float = SCALE_M, k1: float = 0.0
) -> Camera:
    """A camera that looks straight at the plane; the world's origin is in the middle of the picture."""
    focal = 1400.0
    lens = Lens(
        width_px=width,
        height_px=height,
        rms_px=0.1,
        distortion=[k1, 0.0, 0.0, 0.0, 0.0],
        matrix=[[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]],
    )
    return Camera(
        lens=lens,
        rotation=[[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        translation_m=[0.0, 0.0, focal * scale_m],
        plane_rms_px=0.1,
        plane_markers=[],
        string_offset_m=0.0,
        scale_m_per_px=scale_m,
        source="given",
    )


def to_pixels(points_m: np.ndarray) -> np.ndarray:
    """World (…, 2) to pixels of the undistorted `flat_camera`."""
    return np.stack(
        [(WIDTH - 1) / 2 + points_m[..., 0] / SCALE_M, (HEIGHT - 1) / 2 - points_m[..., 1] / SCALE_M], -1
    )


def draw_line(image: np.ndarray, line_px: np.ndarray, width_px: float, level: float) -> None:
    """Draw an anti-aliased polyline (K, 2) by distance, in place."""
    low = np.maximum(np.floor(line_px.min(axis=0)).astype(int) - 6, 0)
    high = np.minimum(np.ceil(line_px.max(axis=0)).astype(int) + 7, [image.shape[1], image.shape[0]])
    cover = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
    fine = cv2.polylines(
        np.zeros((cover.shape[0] * 4, cover.shape[1] * 4), np.uint8),
        [np.rint(((line_px - low + 0.5) * 4 - 0.5) * 16).astype(np.int32)],
        False,
        255,
        max(1, round(width_px * 4)),
        cv2.LINE_AA,
        4,
    )
    cover = (
        cv2.resize(fine, (cover.shape[1], cover.shape[0]), interpolation=cv2.INTER_AREA).astype(np.float32)
        / 255
    )
    part = image[low[1] : high[1], low[0] : high[0]]
    part += cover * (level - part)


def draw_marker(image: np.ndarray, corners_px: np.ndarray, marker: int) -> None:
    """Draw an ArUco marker with its black square's corners at (4, 2) px (pixel centres), white rim around."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    side, rim, fine = 480, 80, 4
    sheet = np.full((side + 2 * rim, side + 2 * rim), 235, np.uint8)
    sheet[rim:-rim, rim:-rim] = np.where(dictionary.generateImageMarker(marker, side) > 0, 235, 20)
    edge = rim - 0.5
    source = np.array([[edge, edge], [edge + side, edge], [edge + side, edge + side], [edge, edge + side]])
    low = np.floor(corners_px.min(axis=0)).astype(int) - 16
    high = np.ceil(corners_px.max(axis=0)).astype(int) + 16
    shape = high - low
    target = (corners_px - low + 0.5) * fine - 0.5
    matrix = cv2.getPerspectiveTransform(source.astype(np.float32), target.astype(np.float32))
    layers = []
    for layer in (sheet, np.full_like(sheet, 255)):
        drawn = cv2.warpPerspective(layer, matrix, tuple((shape * fine).tolist()), flags=cv2.INTER_AREA)
        layers.append(
            cv2.resize(drawn, tuple(shape.tolist()), interpolation=cv2.INTER_AREA).astype(np.float32)
        )
    part = image[low[1] : high[1], low[0] : high[0]]
    part += layers[1] / 255 * (layers[0] - part)


def write_video(path, frames, rate_hz: int = 500, codec: str = "ffv1", pixel_format: str = "gray") -> None:
    """Write grey frames (uint8 or uint16) as a video."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate_hz)
        for index, frame in enumerate(frames):
            if index == 0:
                stream.height, stream.width = frame.shape
                stream.pix_fmt = pixel_format
            picture = av.VideoFrame.from_ndarray(
                frame, format="gray" if frame.dtype == np.uint8 else "gray16le"
            )
            if picture.format.name != pixel_format:
                picture = picture.reformat(format=pixel_format)
            container.mux(stream.encode(picture))
        container.mux(stream.encode())


def swing(length_m: float, time_s: np.ndarray, links: int = 150) -> tuple[np.ndarray, np.ndarray]:
    """Hand poses (T, 3) and string curves (T, links + 1, 2), m: a prescribed, inextensible whip.

    It hangs at rest until 0.02 s, then the hand sweeps and a wave of bends runs to the tip.
    """
    ease = np.clip((time_s - 0.02) / 0.16, 0.0, 1.0)
    ease = ease**3 * (10 - 15 * ease + 6 * ease**2)
    turn = -1.9 + 2.2 * ease
    hand = np.column_stack([-0.12 + 0.22 * np.cos(turn), 0.12 + 0.22 * np.sin(turn), turn + 0.3])
    share = (np.arange(links) + 0.5) / links
    wave = np.sin(2 * np.pi * (1.2 * share[None] - 1.5 * ease[:, None]))
    lag = np.clip(1.4 * ease[:, None] - 0.4 * share[None], 0.0, 1.0)
    heading = -np.pi / 2 + 2.4 * lag + 1.1 * np.sin(np.pi * ease)[:, None] * share[None] * wave
    steps = length_m / links * np.stack([np.cos(heading), np.sin(heading)], axis=2)
    curve = np.concatenate([np.zeros((len(time_s), 1, 2)), np.cumsum(steps, axis=1)], axis=1)
    return hand, curve + hand[:, None, :2]


MARKER_M, MARKER_PLACE_M = 0.05, (-0.06, 0.0)
HAND_MARKER = HandMarker(7, MARKER_M, MARKER_PLACE_M)


def tracker_input(path, length_m=0.3, points=10, **changes) -> TrackerInput:
    """What the tracker gets for a filmed swing."""
    known = {
        "video": path,
        "facts": inspect_video(path),
        "camera": flat_camera(),
        "string": String(length_m=length_m, points=points),
        "free_length_m": length_m,
        "markers": (HAND_MARKER,),
    }
    return TrackerInput(**(known | changes))


def track(path, length_m=0.3, **changes) -> Tracked:
    """Track a filmed swing with the default settings."""
    return track_video(tracker_input(path, length_m, **changes), TrackSettings())


def draw_frame(background, hand, curves_px, thickness_px, level, tip_radius_px, noise, rng) -> np.ndarray:
    """Draw one frame: arm and marker at `hand`, the string as the mean of its curves (S, K, 2)."""
    image = background.copy()
    c, s = np.cos(hand[2]), np.sin(hand[2])
    turn = np.array([[c, s], [-s, c]])
    elbow = to_pixels(np.array([[-0.45, 0.15], hand[:2] - 0.01 * np.array([c, s])]))
    draw_line(image, elbow, 26, 150)
    square = 0.5 * MARKER_M * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) + MARKER_PLACE_M
    draw_marker(image, to_pixels(square @ turn + hand[:2]), 7)
    total = np.zeros_like(image)
    for curve in curves_px:
        layer = image.copy()
        draw_line(layer, curve, thickness_px, level)
        if tip_radius_px:
            cv2.circle(
                layer,
                np.rint(curve[-1] * 16).astype(int).tolist(),
                int(tip_radius_px * 16),
                level,
                -1,
                cv2.LINE_AA,
                4,
            )
        total += layer
    image = cv2.GaussianBlur(total / len(curves_px), (0, 0), 0.6)
    return np.clip(np.rint(image + rng.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)


RATE_HZ, EXPOSURE_S = 500, 4e-4


def cover(picture, curve_px, margin=12) -> None:
    """Hide a string's outer four fifths (K, 2) behind a grey board, in place."""
    outer = curve_px[len(curve_px) // 5 :]
    left, top = np.maximum(outer.min(axis=0).astype(int) - margin, 0)
    right, bottom = outer.max(axis=0).astype(int) + margin
    picture[top:bottom, left:right] = 120


def film(
    path,
    length_m=0.3,
    frames=110,
    tip_radius_px=0.0,
    noise=2.5,
    thickness_px=2.0,
    level=35.0,
    seed=3,
    hidden=(0, 0),
):
    """Write a video of a swing; returns hand poses (F, 3) and curves (F, K, 2), m, at mid exposure.

    From the first to before the second frame of `hidden` the string is behind a board.
    """
    rng = np.random.default_rng(seed)
    middle_s = np.arange(frames) / RATE_HZ
    instants = EXPOSURE_S * np.linspace(-0.4, 0.4, 5)
    background = np.full((HEIGHT, WIDTH), 185.0, np.float32)
    rough = cv2.GaussianBlur(rng.normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 9)
    background += 18 * rough / rough.std()
    for x in range(60, WIDTH, 170):
        background[:, x : x + 3] -= 50
    hands, curves = swing(length_m, middle_s)
    pictures = []
    for f in range(frames):
        inside = to_pixels(swing(length_m, middle_s[f] + instants)[1])
        pictures.append(
            draw_frame(background, hands[f], inside, thickness_px, level, tip_radius_px, noise, rng)
        )
        if hidden[0] <= f < hidden[1]:
            cover(pictures[f], to_pixels(curves[f]))
    write_video(path, pictures, RATE_HZ)
    return hands, curves
