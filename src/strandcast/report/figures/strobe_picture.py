"""The tracker's strobe picture with the target, the measured points and the simulated string over it."""

from __future__ import annotations

import base64
import io

import cv2
import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray
from PIL import Image

from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera
from strandcast.report.numbers import millimetres, place
from strandcast.report.reportlet import Reportlet
from strandcast.report.results import FILES, Results

Array = NDArray[np.float64]
LARGEST_BYTES = 1_500_000


def strobe_picture(key: str, title: str, results: Results) -> Reportlet:
    """Return the picture of the throw, drawn upon where there is a camera to say where things lie in it."""
    picture: bytes = results.need("strobe")
    if len(picture) > LARGEST_BYTES:
        raise StrandcastError(
            "SC-H021",
            f"the picture has {len(picture) / 1e6:.1f} MB, too much for a page",
            file=FILES["strobe"],
            fix="open the file beside this page",
        )
    width, height = Image.open(io.BytesIO(picture)).size
    verdict = results.need("verdict")
    finding = (
        f"The tip passed the target at {place(verdict.target_m)} at {millimetres(verdict.miss_m)}."
        if verdict.miss_m is not None
        else f"The tip's closest approach was not seen: {verdict.reason}."
    )
    try:
        drawn = _overlay(results, width)
    except StrandcastError as problem:
        drawn = Markup("")
        finding += f" Nothing is drawn over the picture: {problem.what}."
    data = base64.b64encode(picture).decode()
    markup = Markup(
        '<svg class="picture" role="img" aria-label="{}" viewBox="0 0 {} {}">'
        '<image href="data:image/webp;base64,{}" width="{}" height="{}"/>{}</svg>'
    ).format(f"Strobe picture of the throw. {finding}", width, height, Markup(data), width, height, drawn)
    return Reportlet(
        key,
        title,
        finding,
        "Large ring: the target. Dashed: the fitted string at the instants of the picture, with the "
        "measured points as small rings, or, where the tracker did not tell its instants, the fitted tip's "
        "path beside the measured one (solid). Good: rings and dashes lie on the string of the picture. "
        "Bad: they lie beside it everywhere (camera or alignment), or at some instants (tracking).",
        markup,
        sources=["strobe.webp"],
    )


def project_px(camera: Camera, places_m: Array, scale: float) -> Array:
    """Return the pixels (K, 2) of places (K, 2) in the string's plane, in a picture `scale` times as wide."""
    depth_m = np.full(len(places_m), camera.string_offset_m)
    world_m = np.column_stack([places_m, depth_m])
    turn, _ = cv2.Rodrigues(np.array(camera.rotation, dtype=float))
    pixels, _ = cv2.projectPoints(
        world_m,
        turn,
        np.array(camera.translation_m, dtype=float),
        np.array(camera.lens.matrix, dtype=float),
        np.array(camera.lens.distortion, dtype=float),
    )
    return np.asarray(pixels.reshape(-1, 2) * scale)


def _overlay(results: Results, width: int) -> Markup:
    """Return the target, and the strings at the picture's instants, or else the tip's paths."""
    camera: Camera = results.need("camera")
    scale, size = width / camera.lens.width_px, width / 640.0
    track, throw = results.need("track"), (results.get("simulated") or {}).get("fitted")
    frames = [int(f) for f in str(results.need("track_summary").choices.get("strobe_frames") or "").split()]
    parts = [_target(results, camera, scale, size)]
    if not frames:
        window = results.in_window()
        parts.append(_line("track", _seen_px(camera, track.points_m[window, -1], scale), size))
        if throw is not None:
            inside = np.isin(throw.frame, track.frame[window])
            parts.append(_line("model", _seen_px(camera, throw.points_m[inside, -1], scale), size))
    for frame in frames:
        if throw is not None and frame in throw.frame:
            string_m = throw.points_m[np.searchsorted(throw.frame, frame)]
            parts.append(_line("model", _seen_px(camera, string_m, scale), size))
        for string_m in track.points_m[track.frame == frame]:
            parts.extend(
                _ring(pixel, size) for pixel in _seen_px(camera, string_m, scale) if np.isfinite(pixel[0])
            )
    return Markup("").join(parts)


def _seen_px(camera: Camera, places_m: Array, scale: float) -> Array:
    """Return pixels (K, 2), NaN for places that were not seen."""
    seen = np.isfinite(places_m).all(axis=1)
    pixels = np.full(places_m.shape, np.nan)
    if seen.any():
        pixels[seen] = project_px(camera, places_m[seen], scale)
    return pixels


def _target(results: Results, camera: Camera, scale: float, size: float) -> Markup:
    verdict = results.need("verdict")
    turn = np.linspace(0.0, 2 * np.pi, 49)
    rim_m = np.array(verdict.target_m) + verdict.hit_radius_m * np.column_stack([np.cos(turn), np.sin(turn)])
    return Markup('<path class="rim" d="{}Z" stroke-width="{:.2f}"/>').format(
        _path(project_px(camera, rim_m, scale)), 1.6 * size
    )


def _line(kind: str, pixels: Array, size: float) -> Markup:
    path = _path(pixels)
    return Markup(
        '<path class="casing" d="{}" stroke-width="{:.2f}"/>'
        '<path class="{}" d="{}" stroke-width="{:.2f}" stroke-dasharray="{}"/>'
    ).format(
        path,
        2.4 * size,
        kind,
        path,
        1.3 * size,
        f"{5 * size:.1f} {2.5 * size:.1f}" if kind == "model" else "none",
    )


def _ring(pixel: Array, size: float) -> Markup:
    return Markup('<circle class="seen" cx="{:.1f}" cy="{:.1f}" r="{:.2f}" stroke-width="{:.2f}"/>').format(
        pixel[0], pixel[1], 1.8 * size, 0.8 * size
    )


def _path(pixels: Array) -> Markup:
    """Return the path's commands; it begins anew after what was not seen."""
    commands, pen = [], "M"
    for u, v in pixels:
        if np.isfinite(u):
            commands.append(f"{pen}{u:.1f} {v:.1f}")
        pen = "L" if np.isfinite(u) else "M"
    return escape("".join(commands))
