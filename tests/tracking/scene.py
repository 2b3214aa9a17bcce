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
