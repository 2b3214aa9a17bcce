"""The tracker's strobe picture with the target, the measured points and the simulated string over it."""

import io

import cv2
import numpy as np
from markupsafe import Markup, escape
from PIL import Image

from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera, is_fisheye
from strandcast.records.verdict import Verdict
from strandcast.report.pages import embedded
from strandcast.report.panels.content import PanelContent
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.results import FILES, Array, TrialResults
from strandcast.report.text import miss_in_words

NOTHING = Markup("")
CAPTURE_CAPTION = (
    "Dashed: the fitted string at the instants of the picture, with the measured points as small rings."
)


def strobe_picture(page: TrialPageData) -> PanelContent:
    """Return the picture of the throw, with overlays if the camera is known."""
    results = page.results
    picture: bytes = results.need("strobe")
    width, _ = _size_px(picture)
    verdict, aimed = results.need("verdict"), results.aimed()
    frames = _instants(results)
    finding = (
        f"The string in {len(frames)} frames."
        if not aimed
        else f"The closest approach: {miss_in_words(verdict)}."
        if verdict.miss_m is not None
        else f"The tip's closest approach was not detected: {verdict.reason}."
    )
    if frames and verdict.closest_frame is not None and verdict.closest_frame not in frames:
        away = min(abs(frame - verdict.closest_frame) for frame in frames)
        finding += f" The picture's nearest instant is {away} frames from it."
    try:
        drawn = _overlay(results, width)
    except StrandcastError as problem:
        drawn = NOTHING
        finding += f" Nothing is drawn over the picture: {problem.what}."
    return PanelContent(
        finding,
        _drawn(picture, f"Strobe picture of the throw. {finding}", drawn),
        sources=["strobe.webp"],
        title=None if aimed else "Strobe picture",
        caption=None if aimed else CAPTURE_CAPTION,
    )


def camera_views(page: TrialPageData) -> PanelContent:
    """Return the picture of the throw by each of several cameras."""
    pictures, found = Markup(""), []
    for camera, (summary, picture) in page.results.views().items():
        found.append(f"{camera}: {100 * summary.tracked_fraction:.0f} % of the points without a flag")
        pictures += Markup("<h3>{}</h3>").format(camera)
        pictures += _drawn(picture, f"Strobe picture by camera {camera}")
    return PanelContent(f"{'; '.join(found)}.", pictures)


def _drawn(picture: bytes, label: str, over: Markup = NOTHING) -> Markup:
    """Return a picture, with what is drawn over it in its pixels."""
    width, height = _size_px(picture)
    data = embedded(picture, FILES["strobe"], "open the file beside this page")
    return Markup(
        '<svg class="picture" role="img" aria-label="{}" viewBox="0 0 {} {}">'
        '<image href="data:image/webp;base64,{}" width="{}" height="{}"/>{}</svg>'
    ).format(label, width, height, data, width, height, over)


def _size_px(picture: bytes) -> tuple[int, int]:
    return Image.open(io.BytesIO(picture), formats=["WEBP"]).size


def project_px(camera: Camera, places_m: Array) -> Array:
    """Return the pixels (..., 2) of places (..., 2) in the string's plane; NaN for unknown places."""
    pixels, known = np.full(places_m.shape, np.nan), np.isfinite(places_m).all(axis=-1)
    if not known.any():
        return pixels
    world_m = np.insert(places_m[known], 2, camera.string_offset_m, axis=1).reshape(1, -1, 3)
    turn, _ = cv2.Rodrigues(np.array(camera.rotation, dtype=float))
    lens = camera.lens
    shift_m, matrix = np.array(camera.translation_m, dtype=float), np.array(lens.matrix, dtype=float)
    project = cv2.fisheye.projectPoints if is_fisheye(lens.distortion) else cv2.projectPoints
    found, _ = project(world_m, turn, shift_m, matrix, np.array(lens.distortion, dtype=float))
    pixels[known] = found.reshape(-1, 2)
    return pixels


def _overlay(results: TrialResults, width: int) -> Markup:
    """Return the target, and the strings at the picture's instants, or else the tip's paths."""
    camera: Camera = results.need("camera")
    scale, size = width / camera.lens.width_px, width / 640.0
    track, throw = results.need("track"), (results.get("simulated") or {}).get("fitted")

    def pixels(places_m: Array) -> Array:
        return project_px(camera, places_m) * scale

    frames, parts = _instants(results), []
    if results.aimed():
        rim = path_of(pixels(rim_m(results.need("verdict"))))
        parts.append(Markup('<path class="rim" d="{}Z" stroke-width="{:.2f}"/>').format(rim, 1.6 * size))
    if not frames:
        window = results.in_window()
        parts.append(_line("track", pixels(track.points_m[window, -1]), size))
        if throw is not None:
            inside = np.isin(throw.frame, track.frame[window])
            parts.append(_line("model", pixels(throw.points_m[inside, -1]), size))
    for frame in frames:
        if throw is not None and frame in throw.frame:
            parts.append(_line("model", pixels(throw.at(frame)), size))
        for string_m in track.points_m[track.frame == frame]:
            parts.extend(_ring(pixel, size) for pixel in pixels(string_m) if np.isfinite(pixel[0]))
    return Markup("").join(parts)


def _instants(results: TrialResults) -> list[int]:
    """Return the frames that the picture shows, none if they are unknown."""
    return [int(f) for f in str(results.need("track_summary").choices.get("strobe_frames") or "").split()]


def rim_m(verdict: Verdict) -> Array:
    """Return the hit radius around the target as places (K, 2)."""
    turn = np.linspace(0.0, 2 * np.pi, 49)
    return np.array(verdict.target()) + verdict.hit_radius_m * np.column_stack([np.cos(turn), np.sin(turn)])


def _line(kind: str, pixels: Array, size: float) -> Markup:
    path = path_of(pixels)
    dashes = f"{5 * size:.1f} {2.5 * size:.1f}" if kind == "model" else "none"
    return Markup(
        '<path class="casing" d="{}" stroke-width="{:.2f}"/>'
        '<path class="{}" d="{}" stroke-width="{:.2f}" stroke-dasharray="{}"/>'
    ).format(path, 2.4 * size, kind, path, 1.3 * size, dashes)


def _ring(pixel: Array, size: float) -> Markup:
    return Markup('<circle class="seen" cx="{:.1f}" cy="{:.1f}" r="{:.2f}" stroke-width="{:.2f}"/>').format(
        pixel[0], pixel[1], 1.8 * size, 0.8 * size
    )


def path_of(pixels: Array) -> Markup:
    """Return the path's commands; it starts again after gaps."""
    commands, pen = [], "M"
    for u, v in pixels:
        if np.isfinite(u):
            commands.append(f"{pen}{u:.1f} {v:.1f}")
        pen = "L" if np.isfinite(u) else "M"
    return escape("".join(commands))
