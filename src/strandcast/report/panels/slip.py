"""How the string slipped out of the clamp: the distance to the tip, which a held string cannot exceed."""

from strandcast.report import drawing as draw
from strandcast.report.causes import clamp_to_tip_m, slip_in_clamp, slip_words
from strandcast.report.panels.content import PanelContent
from strandcast.report.panels.page_data import TrialPageData


def slip_panel(page: TrialPageData) -> PanelContent:
    """Return the distance from the clamp to the tip over time."""
    results = page.results
    slip, start_s = slip_in_clamp(results), results.need("alignment").motion_start_s
    assert slip is not None
    figure = draw.new_figure(10.0, 2.6, left=0.07, top=0.96, bottom=0.22)
    axes = figure.add_subplot()
    before = results.robot_time_s() <= results.window_s()[1]
    since_ms = 1e3 * (results.robot_time_s()[before] - start_s)
    axes.plot(since_ms, 1e3 * clamp_to_tip_m(results.need("track"))[before], **draw.MEASURED)
    axes.axhline(1e3 * slip.at_rest_m, **draw.dashes(draw.FITTED), label="length at rest")
    axes.axvline(1e3 * slip.since_start_s, color=draw.INK, linewidth=1.0, label="slip")
    lowest_mm = 800.0 * slip.at_rest_m  # a slip is a few per cent of the length
    axes.set(xlabel=draw.SINCE_START, ylabel="clamp to tip [mm]", ylim=(lowest_mm, None))
    axes.legend(loc="lower right")
    drawing = draw.Drawing(figure, "Distance from the clamp to the tip over time.", (axes,))
    return PanelContent(f"{slip_words(results)}.", drawing, sources=["track.parquet", "alignment.json"])
