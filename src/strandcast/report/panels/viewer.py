"""The throw frame by frame: its film, with what was measured and fitted drawn over it, and a film strip."""

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from strandcast.records.camera import Camera
from strandcast.records.clip import PLAYED_HZ, Clip, StripPicture
from strandcast.report.measures import fitted_rows, runs, target_distance_m
from strandcast.report.numbers import counted, millimetres, milliseconds
from strandcast.report.pages import render
from strandcast.report.panels.content import PanelContent
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.panels.strobe_picture import path_of, project_px, rim_m
from strandcast.report.results import Array, TrialResults

Whole = NDArray[np.int64]

SLOWER = 20  # than the throw, while the film plays
STEPS_PER_PX = 16  # of places on the page
MISSING = -32768  # a place that is unknown or far outside of the picture
MOST_RUNS = 200  # chosen: flagged runs to jump to
LOWEST_M = 1e-3  # on the plot's logarithmic axis
DECADES_MM = (10, 100)  # its labels
CAPTURE_CAPTION = (
    "Blue rings: the measured points; yellow squares: flagged ones (unsure, hidden, predicted). Dashed: the "
    "fitted string."
)
PLOT = (1000.0, 100.0)  # width and height of the plot, in units of its own


@dataclass(frozen=True)
class Film:
    """What the viewer shows of each of K frames: K numbers, and K places of n + 1 points."""

    frame: Whole  # of the camera
    measured_m: Array  # (K, n + 1, 2)
    flagged: NDArray[np.bool_]  # (K, n + 1): unsure, hidden, predicted or not found
    fitted_m: Array  # (K, n + 1, 2)
    to_target_m: Array  # of the tip; NaN without a target
    error_m: Array  # mean distance between detected and fitted points
    since_start_s: Array  # of the motion
    counts: NDArray[np.bool_]  # whether the fit counts it

    def at(self, frame: int | None) -> int | None:
        """Return the place of a camera's frame in the film, or of the last frame before it; None outside."""
        if frame is None or not self.frame[0] <= frame <= self.frame[-1]:
            return None
        return int(np.searchsorted(self.frame, frame, side="right")) - 1

    def flagged_runs(self) -> list[tuple[int, int]]:
        """Return first and last place of each run of frames with a flagged point of the string."""
        return runs(np.asarray(self.flagged[:, 1:].any(axis=1)))

    def worst(self) -> int | None:
        """Return the place of the frame with the largest error, among those of the fit."""
        counted_m = np.where(self.counts, self.error_m, np.nan)
        return int(np.nanargmax(counted_m)) if np.isfinite(counted_m).any() else None


def viewer(page: TrialPageData) -> PanelContent:
    """Return the viewer; where scripts do not run, the film strip stands alone."""
    results = page.results
    clip, verdict = results.need("clip"), results.need("verdict")
    film, camera = film_of(results, clip), results.need("camera")
    closest = film.at(verdict.closest_frame)
    finding = _finding(film, closest, verdict.miss_m)
    rim = path_of(clip_px(camera, clip, rim_m(verdict))) if results.aimed() else None
    return PanelContent(
        finding,
        viewer_markup(clip, film, camera, finding, rim=rim, closest=closest),
        sources=["clip.json"],
        title=None if results.aimed() else "The capture, frame by frame",
        caption=None if results.aimed() else CAPTURE_CAPTION,
    )


def viewer_markup(
    clip: Clip,
    film: Film,
    camera: Camera,
    finding: str,
    rim: Markup | None = None,
    closest: int | None = None,
    since: str = "the motion’s start",
) -> Markup:
    """Return the viewer of a film; its times are counted since an instant.

    `rim` is the target's, `closest` the place of the closest approach in the film.
    """
    measured_px, fitted_px = (clip_px(camera, clip, each) for each in (film.measured_m, film.fitted_m))
    highest_m = max(0.2, *np.nan_to_num([film.to_target_m, film.error_m]).ravel())
    markup = render(
        "viewer.html.jinja",
        clip=clip,
        film=film,
        finding=finding,
        played_hz=PLAYED_HZ,
        play_rate=clip.rate_hz / (SLOWER * clip.step * PLAYED_HZ),
        slower=SLOWER,
        measured=whole_steps(STEPS_PER_PX * measured_px),
        fitted=whole_steps(STEPS_PER_PX * fitted_px),
        flagged=in_base64(film.flagged.astype("u1")),
        numbers=in_base64(_numbers(film)),
        rim=rim,
        since=since,
        closest=closest,
        worst=film.worst(),
        is_fitted=bool(np.isfinite(film.fitted_m).any()),
        runs=film.flagged_runs()[:MOST_RUNS],
        plot=PLOT,
        lines={"track": _line(film.to_target_m, highest_m), "model": _line(film.error_m, highest_m)},
        decades={mm: float(_height(np.array(1e-3 * mm), highest_m)) for mm in DECADES_MM},
        strip=[_tile(film, picture, measured_px, fitted_px) for picture in clip.strip],
        closest_frame=None if closest is None else int(film.frame[closest]),
    )
    return Markup(markup)


def film_of(results: TrialResults, clip: Clip) -> Film:
    """Return what was measured and fitted in the frames of a clip."""
    track, throw = results.need("track"), (results.get("simulated") or {}).get("fitted")
    frame = clip.first_frame + clip.step * np.arange(clip.frames)
    shape = (len(frame), *track.points_m.shape[1:])
    measured_m, fitted_m, since_s = (np.full(size, np.nan) for size in (shape, shape, len(frame)))
    flagged, counts = np.ones(shape[:2], bool), np.ones(len(frame), bool)
    detected = np.zeros(shape[:2], bool)
    _, mine, theirs = np.intersect1d(frame, track.frame, return_indices=True)
    measured_m[mine], detected[mine] = track.points_m[theirs], track.detected()[theirs]
    flagged[mine] = (track.flags[theirs] != 0) | ~np.isfinite(track.points_m[theirs]).all(axis=2)
    if (alignment := results.get("alignment")) is not None:
        since_s[mine] = results.robot_time_s()[theirs] - alignment.motion_start_s
        if results.get("estimate") is not None:
            counts[mine] = fitted_rows(results)[theirs]
    if throw is not None and throw.points_m.shape[1:] == shape[1:]:
        fitted_m = throw.at(frame)
    apart_m = np.linalg.norm(measured_m[:, 1:] - fitted_m[:, 1:], axis=2)
    known = np.isfinite(apart_m) & detected[:, 1:]
    counted_points = np.where(known.any(axis=1), known.sum(axis=1), np.nan)
    error_m = np.where(known, apart_m, 0.0).sum(axis=1) / counted_points
    to_target_m = np.full(len(frame), np.nan)
    if results.aimed():
        to_target_m = target_distance_m(results.need("verdict"), measured_m[:, -1])
    return Film(frame, measured_m, flagged, fitted_m, to_target_m, error_m, since_s, counts)


def clip_px(camera: Camera, clip: Clip, places_m: Array) -> Array:
    """Return the pixels (..., 2) of places (..., 2) in the small video; NaN for unknown places."""
    left, top, width, height = clip.box_px
    scale = np.array([clip.width_px / width, clip.height_px / height])
    # A pixel's middle has whole coordinates, in both pictures.
    return np.asarray((project_px(camera, places_m) - (left, top) + 0.5) * scale - 0.5)


def _finding(film: Film, closest: int | None, miss_m: float | None) -> str:
    parts = [f"Frames {film.frame[0]} to {film.frame[-1]} of the camera"]
    if closest is not None:
        parts.append(f"closest approach at frame {film.frame[closest]}: {millimetres(miss_m)}")
    if (worst := film.worst()) is not None:
        error = millimetres(float(film.error_m[worst]))
        parts.append(f"worst fit in frame {film.frame[worst]}, {error} in the mean over the string")
    parts.append(f"{counted(len(film.flagged_runs()), 'run')} of frames with flagged points")
    return "; ".join(parts) + "."


def _tile(film: Film, picture: StripPicture, measured_px: Array, fitted_px: Array) -> dict[str, Any]:
    """Return what a picture of the film strip shows: its place in the film, its caption, and its paths."""
    k = film.at(picture.frame) or 0
    text = f"frame {picture.frame}"
    if np.isfinite(film.since_start_s[k]):
        text += f", {milliseconds(float(film.since_start_s[k]), digits=0)}"
    paths = {"measured": path_of(measured_px[k]), "fitted": path_of(fitted_px[k])}
    return {"frame": picture.frame, "webp": picture.webp, "place": k, "text": text} | paths


def whole_steps(places: Array) -> str:
    """Return places in a step of the page, rounded to two bytes each, in base64."""
    steps = np.rint(places)
    return in_base64(np.where(np.abs(steps) < -MISSING, steps, MISSING).astype("<i2"))


def _numbers(film: Film) -> NDArray[np.float32]:
    """Return for each frame: tip to target [mm], error [mm], time [ms]."""
    columns = [film.to_target_m, film.error_m, film.since_start_s]
    return (1e3 * np.column_stack(columns)).astype("<f4")


def in_base64(values: NDArray[np.generic]) -> str:
    """Return the bytes of an array in base64."""
    return base64.b64encode(values.tobytes()).decode()


def _height(length_m: Array, highest_m: float) -> Array:
    """Return heights in the plot, from its top, of lengths on its logarithmic axis."""
    share = np.log(np.maximum(length_m, LOWEST_M) / LOWEST_M) / np.log(highest_m / LOWEST_M)
    return np.asarray(PLOT[1] * (1.0 - share))


def _line(length_m: Array, highest_m: float) -> Markup:
    across = PLOT[0] * np.arange(len(length_m)) / max(1, len(length_m) - 1)
    known = np.where(np.isfinite(length_m), across, np.nan)
    return path_of(np.column_stack([known, _height(length_m, highest_m)]))
