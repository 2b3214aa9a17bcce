"""The page of a tracked film: the viewer, length, speed and curvature over time, and what is doubtful."""

from typing import Any

import numpy as np
from markupsafe import Markup

from strandcast.camera.flat import flat_camera
from strandcast.film.result import FilmTrack
from strandcast.records.clip import Clip
from strandcast.report.drawing import MEASURED, Drawing, drawing, new_figure, to_svg
from strandcast.report.measures import runs
from strandcast.report.numbers import percent
from strandcast.report.pages import render
from strandcast.report.panels.tracking import kymograph
from strandcast.report.panels.viewer import Film, viewer_markup
from strandcast.tracking.clip import VideoFrames, make_clip

MOST_RUNS = 40  # chosen: of doubtful frames, listed on the page


def film_page(track: FilmTrack, files: list[str]) -> str:
    """Return the page of a tracked film; `files` are links beside it."""
    doubt, count = track.doubtful(), len(track.time_s)
    finding = f"{count} frames; {percent(float(1.0 - doubt.mean()))} show every point without doubt."
    doubtful = runs(doubt)
    with drawing():
        markup = to_svg(_over_time(track), "over-time")
    return render(
        "film.html.jinja",
        title=track.video.name,
        finding=finding,
        facts=_facts(track),
        viewer=_viewer(track, finding),
        figure=markup,
        doubtful=doubtful[:MOST_RUNS],
        more=max(0, len(doubtful) - MOST_RUNS),
        warnings=track.advice(),
        files=files,
        points=track.flags.shape[1] - 1,
    )


def _facts(track: FilmTrack) -> dict[str, str]:
    facts = track.facts
    size = f"{facts.width_px} × {facts.height_px} px at {facts.frame_rate_hz:.6g} frames/s"
    return {
        "Film": f"{size} (by {facts.frame_rate_source}), {track.time_s[-1]:.3g} s",
        "Held": track.assumed["held"],
        "Scale": track.assumed["scale"],
        "Length": track.assumed["length"],
    }


def _viewer(track: FilmTrack, finding: str) -> Markup:
    """Return the viewer, for which a pixel is a metre of a camera that looks straight at the plane."""
    facts, points = track.facts, track.points_px * (1.0, -1.0)
    count = len(points)
    camera = flat_camera(facts.width_px, facts.height_px, 1.0, (0.0, 0.0))
    fields = make_clip(VideoFrames(track.video, facts), facts, points, camera, None, (0, count - 1))
    clip = Clip(experiment=track.video.stem, trial=1, **fields)
    frame = clip.first_frame + clip.step * np.arange(clip.frames)
    unknown = np.full(len(frame), np.nan)
    film = Film(
        frame,
        points[frame],
        (track.confidence() < 1.0)[frame],
        np.full(points[frame].shape, np.nan),
        unknown,
        unknown,
        track.time_s[frame],
        np.ones(len(frame), bool),
    )
    return viewer_markup(clip, film, camera, finding, since="the first frame")


def _over_time(track: FilmTrack) -> Drawing:
    """Return length, speed of the end, and curvature of each point, over the frames."""
    figure = new_figure(10.0, 6.0, left=0.08, right=1.0, top=0.95, bottom=0.09, hspace=0.45)
    axes: Any = figure.subplots(3, 1)
    frame, unit = np.arange(len(track.time_s)), track.unit
    curved = track.curvature().T
    known = np.abs(curved[np.isfinite(curved)])
    most = max(float(np.percentile(known, 99)) if len(known) else 0.0, 1e-9)
    extent = (-0.5, frame[-1] + 0.5)
    kymograph(axes[2], curved, extent, f"curvature [1/{unit}]", cmap="PuOr", vmin=-most, vmax=most)
    for plot, values, label, title in (
        (axes[0], track.length, f"length [{unit}]", "from the held end to the visible end"),
        (axes[1], track.end_speed(), f"speed [{unit}/s]", "of the end"),
    ):
        plot.plot(frame, values, **MEASURED)
        plot.set(ylabel=label, xlim=(-0.5, frame[-1] + 0.5))
        plot.set_title(title)
        figure.colorbar(axes[2].images[0], ax=plot, pad=0.01, fraction=0.08, aspect=12).ax.set_visible(False)
    axes[2].set(xlabel="frame", ylabel="point (0: held)")
    axes[2].set_title("curvature at each point, positive to the left; empty: not found")
    alt = "Length, speed of the end and curvature over the frames."
    return Drawing(figure, alt, frame_axes=tuple(axes))
