"""The whole track in one figure, σ of every point and length of every segment; and a slip in the clamp."""

from typing import Any

import numpy as np
from matplotlib.colors import LogNorm

from strandcast.report.causes import clamp_to_tip_m, slip_in_clamp, slip_words
from strandcast.report.drawing import FITTED, INK, MEASURED, SINCE_START, Drawing, dashes, new_figure
from strandcast.report.measures import runs
from strandcast.report.numbers import millimetres, percent, signed
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.typeset import quantity

MOST_COLUMNS = 1500


def tracking(page: TrialPageData) -> PanelContent:
    """Return kymographs of σ and of the segments' length errors."""
    results = page.results
    track, summary = results.need("track"), results.need("track_summary")
    figure = new_figure(10.0, 4.6, left=0.07, right=1.0, top=0.94, bottom=0.1, hspace=0.4)
    sigma_axes, length_axes = figure.subplots(2, 1)
    sigma_mm = np.where(np.isfinite(track.points_m).all(axis=2), track.sigma_m, np.nan).T * 1e3
    usual_mm = summary.length_m / summary.points * 1e3
    segment_m = np.linalg.norm(np.diff(track.points_m, axis=1), axis=2)
    error = (segment_m.T * 1e3 / usual_mm - 1.0) * 100
    extent = (float(track.frame[0]) - 0.5, float(track.frame[-1]) + 0.5)
    sure_mm = np.where(sigma_mm > 0, sigma_mm, np.nan)
    kymograph(sigma_axes, sure_mm, extent, "σ [mm]", norm=LogNorm(0.1, 10.0), cmap="cividis")
    kymograph(length_axes, error, extent, "length error [%]", vmin=-20.0, vmax=20.0, cmap="PuOr")
    sigma_axes.set_title("σ of each point; empty: not detected")
    length_axes.set_title("length of each segment against L/n; empty: not detected")
    sigma_axes.set_ylabel("point (0: hand)")
    length_axes.set(xlabel="frame", ylabel="segment")
    length_m = segment_m.sum(axis=1)
    whole = np.isfinite(length_m)
    finding = (
        f"{percent(summary.tracked_fraction)} of points detected without a flag, the tip in "
        f"{percent(summary.tip_fraction)} of frames, the hand's marker in "
        f"{percent(summary.marker_fraction)}; median σ {millimetres(summary.median_sigma_m, digits=2)}."
    )
    if (slip := slip_words(results)) is not None:
        finding += f" Length from clamp to tip: {slip}; the string’s is {millimetres(summary.length_m)}."
    elif whole.any():
        finding += (
            f" Measured length {millimetres(float(np.median(length_m[whole])))} (median), "
            f"the string's is {millimetres(summary.length_m)}."
        )
    found = detected_table(summary, results.aimed())
    detected = [found] if found.rows or not results.supplied() else []  # in captures nothing is looked for
    return PanelContent(
        finding,
        Drawing(figure, f"Tracking quality, point by frame. {finding}", frame_axes=(sigma_axes, length_axes)),
        [_lost_table(track), *detected, _choice_table(summary)],
        ["track.parquet", "track.json"],
    )


def kymograph(
    axes: Any, values: Any, extent: tuple[float, float], label: str, first: int = 0, **colours: Any
) -> None:
    """Draw values (points, frames) as an image; `extent` is that of the frames, `first` the first point."""
    step = max(1, -(-values.shape[1] // MOST_COLUMNS))
    shown = axes.imshow(
        values[:, ::step],
        aspect="auto",
        origin="lower",
        interpolation="nearest",
        extent=(*extent, first - 0.5, first + values.shape[0] - 0.5),
        **colours,
    )
    bar = axes.figure.colorbar(shown, ax=axes, pad=0.01, fraction=0.08, aspect=12, format="{x:g}")
    bar.set_label(label)
    bar.outline.set_edgecolor(INK)
    axes.grid(visible=False)


def _lost_table(track: Any) -> Table:
    """Return the longest runs of frames without the tip."""
    lost = runs(~np.isfinite(track.points_m[:, -1]).all(axis=1))
    longest = sorted(lost, key=lambda run: run[0] - run[1])[:6]
    rows = [
        [str(track.frame[first]), str(track.frame[last]), str(last - first + 1)]
        for first, last in sorted(longest)
    ]
    caption = (
        "The longest runs of frames, of the whole film, in which the tip was not found at all; frames in "
        "which it is doubtful are not among them."
        if rows
        else "The tip was detected in every frame of the track."
    )
    return Table(["tip lost from frame", "to frame", "frames"], rows, caption)


def detected_table(summary: Any, aimed: bool = True) -> Table:
    """Return what was detected on the string and, if there is one, at the target."""
    rows = []
    for weight in summary.weights:
        at = f"{1e3 * weight.place_m:.1f} ± {1e3 * weight.sigma_m:.1f} mm from the clamp"
        rows.append(["weight", at, f"{2e3 * weight.half_width_m:.1f} mm wide"])
    for section in summary.sections:
        start = f"{1e3 * section.from_m:.0f} ± {1e3 * section.from_sigma_m:.0f}"
        end = f"{1e3 * section.to_m:.0f} ± {1e3 * section.to_sigma_m:.0f} mm from the clamp"
        width = f"{1e3 * section.width_m:.1f} mm wide"
        rows.append(["section of another width", f"{start} to {end}", width])
    if summary.target is not None:
        # Adding zero turns −0.0 into 0.0.
        x, y = (signed(f"{round(1e3 * each, 1) + 0.0:+.1f}") for each in summary.target.offset_m)
        place = f"{x} mm in x, {y} mm in y from target_m"
        rows.append(["target", place, f"radius {1e3 * summary.target.radius_m:.1f} mm"])
    if summary.contact is not None:
        contact = summary.contact
        when = f"frame {contact.frame}, {contact.camera_time_s:.3f} s on the camera's clock"
        rows.append(["contact with the target", when, f"evidence: {', '.join(contact.evidence)}"])
    where = "on the string and at the target" if aimed else "on the string"
    caption = f"Detected {where}." if rows else "Nothing was detected on the string."
    return Table(["detected", "where", "what"], rows, caption)


def _choice_table(summary: Any) -> Table:
    rows = [list(quantity(*choice)) for choice in sorted(summary.choices.items())]
    return Table(
        ["choice of the tracker", "value"], rows, "" if rows else "The tracker made no automatic choices."
    )


def slip_panel(page: TrialPageData) -> PanelContent:
    """Return the distance from the clamp to the tip over time."""
    results = page.results
    slip, start_s = slip_in_clamp(results), results.need("alignment").motion_start_s
    assert slip is not None
    figure = new_figure(10.0, 2.6, left=0.07, top=0.96, bottom=0.22)
    axes = figure.add_subplot()
    before = results.robot_time_s() <= results.window_s()[1]
    since_ms = 1e3 * (results.robot_time_s()[before] - start_s)
    axes.plot(since_ms, 1e3 * clamp_to_tip_m(results.need("track"))[before], **MEASURED)
    axes.axhline(1e3 * slip.at_rest_m, **dashes(FITTED), label="length at rest")
    axes.axvline(1e3 * slip.since_start_s, color=INK, linewidth=1.0, label="slip")
    lowest_mm = 800.0 * slip.at_rest_m  # a slip is a few per cent of the length
    axes.set(xlabel=SINCE_START, ylabel="clamp to tip [mm]", ylim=(lowest_mm, None))
    axes.legend(loc="lower right")
    drawing = Drawing(figure, "Distance from the clamp to the tip over time.", (axes,))
    return PanelContent(f"{slip_words(results)}.", drawing, sources=["track.parquet", "alignment.json"])
