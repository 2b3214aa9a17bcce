"""A small world for the tracker's tests: a curve, drawn by its analytic distance, blurred by motion, with noise.

It shares nothing with the lab: no physics, no renderer.
"""

from __future__ import annotations

import av
import cv2
import numpy as np

from strandcast.records.camera import Camera, Lens

SCALE_M = 0.0015
WIDTH, HEIGHT = 800, 600


def flat_camera(width: int = WIDTH, height: int = HEIGHT, scale_m: float = SCALE_M, k1: float = 0.0) -> Camera:
    """A camera that looks straight at the plane; the world's origin is in the middle of the picture."""
    focal = 1400.0
    lens = Lens(
        width_px=width, height_px=height, rms_px=0.1, distortion=[k1, 0.0, 0.0, 0.0, 0.0],
        matrix=[[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]],
    )  # fmt: skip
    return Camera(
        lens=lens, rotation=[[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        translation_m=[0.0, 0.0, focal * scale_m], plane_rms_px=0.1, plane_markers=[], string_offset_m=0.0,
        scale_m_per_px=scale_m, source="given",
    )  # fmt: skip


def to_pixels(points_m: np.ndarray) -> np.ndarray:
    """World (…, 2) to pixels of the undistorted `flat_camera`."""
    return np.stack([(WIDTH - 1) / 2 + points_m[..., 0] / SCALE_M, (HEIGHT - 1) / 2 - points_m[..., 1] / SCALE_M], -1)


def draw_line(image: np.ndarray, line_px: np.ndarray, width_px: float, level: float) -> None:
    """Draw an anti-aliased polyline (K, 2) by distance, in place."""
    low = np.maximum(np.floor(line_px.min(axis=0)).astype(int) - 6, 0)
    high = np.minimum(np.ceil(line_px.max(axis=0)).astype(int) + 7, [image.shape[1], image.shape[0]])
    cover = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
    fine = cv2.polylines(
        np.zeros((cover.shape[0] * 4, cover.shape[1] * 4), np.uint8),
        [np.rint(((line_px - low + 0.5) * 4 - 0.5) * 16).astype(np.int32)], False, 255,
        max(1, round(width_px * 4)), cv2.LINE_AA, 4,
    )  # fmt: skip
    cover = cv2.resize(fine, (cover.shape[1], cover.shape[0]), interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    part = image[low[1] : high[1], low[0] : high[0]]
    part += cover * (level - part)


def draw_marker(image: np.ndarray, corners_px: np.ndarray, marker: int) -> None:
    """Draw an ArUco marker with its black square's corners at (4, 2) px (pixel centres), white rim around."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    side = 480
    sheet = np.full((side + 160, side + 160), 235, np.uint8)
    sheet[80:-80, 80:-80] = np.where(dictionary.generateImageMarker(marker, side) > 0, 235, 20)
    source = np.array([[79.5, 79.5], [79.5 + side, 79.5], [79.5 + side, 79.5 + side], [79.5, 79.5 + side]])
    big = 4
    matrix = cv2.getPerspectiveTransform(source.astype(np.float32), ((corners_px + 0.5) * big - 0.5).astype(np.float32))
    shape = (image.shape[1] * big, image.shape[0] * big)
    drawn = cv2.warpPerspective(sheet, matrix, shape, flags=cv2.INTER_AREA, borderValue=0)
    mask = cv2.warpPerspective(np.full_like(sheet, 255), matrix, shape, borderValue=0)
    drawn = cv2.resize(drawn, image.shape[::-1], interpolation=cv2.INTER_AREA).astype(np.float32)
    mask = cv2.resize(mask, image.shape[::-1], interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    image += mask * (drawn - image)


def write_video(path, frames, rate_hz: int = 500, codec: str = "ffv1", pixel_format: str = "gray") -> None:
    """Write grey frames (uint8 or uint16) as a video."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate_hz)
        for index, frame in enumerate(frames):
            if index == 0:
                stream.height, stream.width = frame.shape
                stream.pix_fmt = pixel_format
            picture = av.VideoFrame.from_ndarray(frame, format="gray" if frame.dtype == np.uint8 else "gray16le")
            if picture.format.name != pixel_format:
                picture = picture.reformat(format=pixel_format)
            container.mux(stream.encode(picture))
        container.mux(stream.encode())


def swing(length_m: float, frames: int, rate_hz: float, tip_mass: float, speed: float = 1.0, links: int = 60):
    """Hand poses (frames, 3) and string curves (frames, links + 1, 2) of a position-based chain in the air."""
    sub, dt = 16, 1.0 / rate_hz / 16
    mass = np.ones(links + 1)
    mass[-1] = tip_mass
    inverse = 1.0 / mass
    inverse[0] = 0.0
    link = length_m / links

    def hand_at(t: float) -> np.ndarray:
        s = np.clip((t - 0.04) * speed / 0.5, 0.0, 1.0)
        ease = s**3 * (10 - 15 * s + 6 * s * s)
        turn = -2.2 + 2.6 * ease
        arm = 0.28
        return np.array([-0.2 + arm * np.cos(turn + 0.5), 0.15 + arm * np.sin(turn + 0.5), turn])

    nodes = np.empty((links + 1, 2))
    nodes[:] = hand_at(0)[:2]
    nodes[:, 1] -= link * np.arange(links + 1)
    velocity = np.zeros_like(nodes)
    hands, curves = [], []
    for frame in range(frames):
        hands.append(hand_at(frame / rate_hz))
        curves.append(nodes.copy())
        for k in range(sub):
            before = nodes.copy()
            velocity[1:, 1] -= 9.81 * dt
            velocity *= 1.0 - 0.4 * dt
            nodes = nodes + velocity * dt
            nodes[0] = hand_at(frame / rate_hz + (k + 1) * dt)[:2]
            for _ in range(12):
                for parity in (0, 1):
                    a = np.arange(parity, links, 2)
                    d = nodes[a + 1] - nodes[a]
                    r = np.linalg.norm(d, axis=1, keepdims=True)
                    w = inverse[a] + inverse[a + 1]
                    c = d / r * (r - link) / w[:, None]
                    nodes[a] += inverse[a][:, None] * c
                    nodes[a + 1] -= inverse[a + 1][:, None] * c
            velocity = (nodes - before) / dt
    return np.array(hands), np.array(curves)


MARKER_M, MARKER_PLACE_M = 0.05, (-0.06, 0.0)


def draw_frame(background, hand, curves_px, thickness_px, level, tip_radius_px, noise, rng) -> np.ndarray:
    """One frame: arm and marker at `hand`, the string as the mean of its curves (S, K, 2) in the exposure."""
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
            cv2.circle(layer, np.rint(curve[-1] * 16).astype(int).tolist(), int(tip_radius_px * 16), level, -1, cv2.LINE_AA, 4)
        total += layer
    image = cv2.GaussianBlur(total / len(curves_px), (0, 0), 0.6)
    return np.clip(np.rint(image + rng.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)


def film(path, length_m=0.3, frames=260, tip_mass=1.0, tip_radius_px=0.0, noise=2.5, speed=1.0, textured=True,
         exposure=0.2, thickness_px=2.0, level=35.0, seed=3):  # fmt: skip
    """Write a video of a swing; returns hand poses (F, 3) and curves (F, K, 2), m, at mid exposure."""
    rng = np.random.default_rng(seed)
    rate = 500
    hands, curves = swing(length_m, frames * 5, rate * 5, tip_mass, speed)
    background = np.full((HEIGHT, WIDTH), 185.0)
    if textured:
        rough = cv2.GaussianBlur(rng.normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 9)
        background += 18 * rough / rough.std()
        for x in range(60, WIDTH, 170):
            background[:, x : x + 3] -= 50
    pictures = []
    for f in range(frames):
        middle = curves[5 * f]
        after = curves[min(5 * f + 1, len(curves) - 1)]
        before = curves[max(5 * f - 1, 0)]
        velocity = (after - before) / 2 * 5  # per frame
        inside = [to_pixels(middle + velocity * exposure * share) for share in np.linspace(-0.5, 0.5, 7)]
        pictures.append(draw_frame(background.astype(np.float32), hands[5 * f], inside, thickness_px, level, tip_radius_px, noise, rng))
    write_video(path, pictures)
    return hands[::5], curves[::5]
