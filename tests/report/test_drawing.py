"""Figures as SVG: the scale that the viewer's cursor uses is that of the plot."""

import re

import pytest

from strandcast.report.drawing import Drawing, drawing, new_figure, to_svg


@pytest.mark.parametrize("clock", ["ms", "frame"])
def test_a_cursor_has_the_scale_of_its_plot(clock: str) -> None:
    with drawing():
        figure = new_figure(8.0, 3.0)
        axes = figure.subplots(2, 1)[1]
        axes.plot([-20.0, 480.0], [0.0, 1.0])
        axes.axvline(123.0, color="#123456")
        times, frames = ((axes,), ()) if clock == "ms" else ((), (axes,))
        svg = to_svg(Drawing(figure, "a plot", times, frames), "plot")
    (line,) = re.findall(r'<line class="now" [^>]*>', svg)
    given = dict(re.findall(r'([\w-]+)="([^"]*)"', line))
    assert given["data-clock"] == clock
    first, last, left, right = (float(given[f"data-{name}"]) for name in ("first", "last", "left", "right"))
    x = left + (123.0 - first) / (last - first) * (right - left)
    drawn = re.search(r'd="M([\d.]+) ([\d.]+)L([\d.]+) ([\d.]+)"[^>]*stroke: #123456', svg)
    assert drawn is not None
    assert float(drawn[1]) == pytest.approx(x, abs=0.02)
    assert sorted(map(float, (drawn[2], drawn[4]))) == pytest.approx(
        sorted(float(given[end]) for end in ("y1", "y2")), abs=0.02
    )
