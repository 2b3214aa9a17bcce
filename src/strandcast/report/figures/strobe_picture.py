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
from strandcast.report.measures import strobe_rows
from strandcast.report.numbers import millimetres, place
from strandcast.report.reportlet import Reportlet
from strandcast.report.results import Results

Array = NDArray[np.float64]
LARGEST_BYTES = 1_500_000


def strobe_picture(key: str, title: str, results: Results) -> Reportlet:
    """Return the picture of the throw, drawn upon where there is a camera to say where things lie in it."""
    picture: bytes = results.need("strobe")
    if len(picture) > LARGEST_BYTES:
        raise StrandcastError(
            "SC-H021",
            f"the picture has {len(picture) / 1e6:.1f} MB, too much for a page",
            file=results.path("strobe"),
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
        "Rings: measured points. Dashed: the fitted string at the same instants. Large ring: the target. "
        "Good: rings and dashes lie on the string of the picture. Bad: they lie beside it everywhere "
        "(camera or alignment), or at some instants (tracking).",
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
    camera: Camera = results.need("camera")
    track, rows = results.need("track"), _rows(results)
    scale = width / camera.lens.width_px
    size = width / 640.0
    parts = [_target(results, camera, scale, size)]
    throw = (results.get("simulated") or {}).get("fitted")
    for row in rows:
        if throw is not None and track.frame[row] in throw.frame:
            string_m = throw.points_m[np.searchsorted(throw.frame, track.frame[row])]
            parts.append(_line(project_px(camera, string_m[np.isfinite(string_m).all(axis=1)], scale), size))
        seen_m = track.points_m[row][np.isfinite(track.points_m[row]).all(axis=1)]
        parts.extend(_ring(pixel, size) for pixel in project_px(camera, seen_m, scale))
    return Markup("").join(parts)


def _rows(results: Results) -> NDArray[np.int64]:
    """Return the rows of the track that the picture is made of, if the tracker wrote its frames down."""
    frames = str(results.need("track_summary").choices.get("strobe_frames") or "").split()
    if not frames:
        return strobe_rows(results)
    return np.nonzero(np.isin(results.need("track").frame, [int(frame) for frame in frames]))[0]


def _target(results: Results, camera: Camera, scale: float, size: float) -> Markup:
    verdict = results.need("verdict")
    turn = np.linspace(0.0, 2 * np.pi, 49)
    rim_m = np.array(verdict.target_m) + verdict.hit_radius_m * np.column_stack([np.cos(turn), np.sin(turn)])
    return Markup('<path class="rim" d="{}Z" stroke-width="{:.2f}"/>').format(
        _path(project_px(camera, rim_m, scale)), 1.6 * size
    )


def _line(pixels: Array, size: float) -> Markup:
    path = _path(pixels)
    return Markup(
        '<path class="casing" d="{}" stroke-width="{:.2f}"/>'
        '<path class="model" d="{}" stroke-width="{:.2f}" stroke-dasharray="{:.1f} {:.1f}"/>'
    ).format(path, 2.4 * size, path, 1.3 * size, 5 * size, 2.5 * size)


def _ring(pixel: Array, size: float) -> Markup:
    return Markup('<circle class="seen" cx="{:.1f}" cy="{:.1f}" r="{:.2f}" stroke-width="{:.2f}"/>').format(
        pixel[0], pixel[1], 1.8 * size, 0.8 * size
    )


def _path(pixels: Array) -> Markup:
    return escape("M" + "L".join(f"{u:.1f} {v:.1f}" for u, v in pixels))
