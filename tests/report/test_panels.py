"""Panels from outside the package are on the pages, without a change to strandcast."""

import shutil
import sys
from html import unescape
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import cast

import pytest
from markupsafe import Markup

from strandcast.core.trial_names import trial_name
from strandcast.records.estimate import Estimate
from strandcast.report.drawing import Drawing, new_figure
from strandcast.report.experiment_page import experiment_page
from strandcast.report.facts import Facts
from strandcast.report.panels import parameters
from strandcast.report.panels.content import Panel, PanelContent, Table, make_section
from strandcast.report.panels.page_data import ExperimentPageData, TrialPageData
from strandcast.report.panels.progress import spaced_ticks
from strandcast.report.panels.registry import PANELS, panels_of
from strandcast.report.results import FILES, read_results
from strandcast.report.summary import summarise
from strandcast.report.trial_page import trial_page

pytestmark = pytest.mark.usefixtures("undrawn")


def tip_height(page: TrialPageData) -> PanelContent:
    """Return the greatest height of the tip, as a curve and as a number."""
    track = page.need("track")
    figure = new_figure(6.0, 3.0)
    figure.add_subplot().plot(track.camera_time_s, track.points_m[:, -1, 1])
    highest_m = float(max(height for height in track.points_m[:, -1, 1] if height == height))
    return PanelContent(
        f"The tip rises to {highest_m:.2f} m.",
        drawing=Drawing(figure, "Height of the tip."),
        tables=[Table(["quantity", "value"], [["highest", f"{highest_m:.2f} m"]])],
        sources=["track.parquet"],
    )


def trial_count(page: ExperimentPageData) -> PanelContent:
    """Return the number of trials."""
    return PanelContent(f"There are {len(page.trials)} trials.", drawing=Markup("<b>count</b>"))


TOY = Panel("tip-height", "Height of the tip", tip_height, needs=("track",))


@pytest.fixture(autouse=True)
def same_panels_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PANELS, "_entries", PANELS.known())


def page_of(results: Path) -> str:
    return trial_page(results / "trial-03", trial=3, experiment="swing")


def test_a_registered_panel_is_on_the_page(results: Path) -> None:
    PANELS.register("trial.tip-height", TOY)
    page = page_of(results)
    assert '<h2 id="tip-height-title">Height of the tip</h2>' in page
    assert '<div id="tip-height">' in page
    assert "The tip rises to 0." in page
    assert 'aria-label="Height of the tip."' in page
    assert page.index('id="truth"') < page.index('id="tip-height"') < page.index('id="checks"')


def test_an_axis_of_trials_names_few_and_none_near_another() -> None:
    for count, step in ((0, 1), (1, 1), (20, 1), (21, 2), (40, 2), (41, 3)):
        trials = list(range(1, count + 1))
        assert spaced_ticks(trials) == trials[::step]
    assert spaced_ticks([1, 2, 99, 100, 101]) == [1, 99]
    assert spaced_ticks([2, 4]) == [2, 4]


def test_an_installed_panel_is_on_the_page(results: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("toy_panels")
    module.height, module.count = TOY, Panel("count", "Number of trials", trial_count)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "toy_panels", module)
    points = [
        EntryPoint("trial.tip-height", "toy_panels:height", PANELS.group),
        EntryPoint("experiment.count", "toy_panels:count", PANELS.group),
        EntryPoint("trial.broken", "toy_panels:missing", PANELS.group),
    ]
    monkeypatch.setattr(
        "importlib.metadata.entry_points", lambda group: points if group == PANELS.group else []
    )
    page = page_of(results)
    assert "The tip rises to 0." in page
    assert "has no attribute &#39;missing&#39;" in page  # on the page, which stays complete
    assert "Number of trials" not in page
    trials = {k: results / trial_name(k) for k in (1, 2, 3)}
    summary = summarise("swing", trials, string_length_m=0.3, target_m=[0.6, 0.7], hit_radius_m=0.02)
    assert "There are 3 trials." in experiment_page(summary, trials, facts=Facts())


def test_a_name_is_used_once_per_page() -> None:
    PANELS.register("trial.tip-height", TOY)
    with pytest.raises(ValueError, match="tip-height"):
        PANELS.register("trial.tip-height", TOY)
    PANELS.register("experiment.tip-height", TOY)


def test_a_missing_result_is_named_instead_of_the_panel(results: Path, tmp_path: Path) -> None:
    PANELS.register("trial.tip-height", TOY)
    page = trial_page(tmp_path / "trial-01", trial=1, experiment="empty")
    section = page[page.index('id="tip-height"') :]
    assert "SC-R001" in section[: section.index("</section>")]


@pytest.mark.parametrize("kind", ["trial", "experiment"])
def test_declared_panels_have_unique_names_and_need_known_results(kind) -> None:
    panels = panels_of(kind)
    assert len({panel.name for panel in panels}) == len(panels)
    assert {name for panel in panels for name in panel.needs} <= set(FILES)


@pytest.mark.parametrize("removed", sorted(set(FILES) - {"ensemble"}))
def test_a_panel_is_a_box_just_if_a_result_that_it_needs_is_missing(
    results: Path, tmp_path: Path, removed: str
) -> None:
    folder = Path(shutil.copytree(results, tmp_path / "swing")) / "trial-03"
    whole = read_results(folder)
    assert not whole.problems
    whole.path(removed).unlink()
    page = TrialPageData(read_results(folder), next_motion=results / "trial-04" / "motion.json")
    assert removed in page.results.problems
    shown = [panel for panel in panels_of("trial") if panel.shown(page)]
    boxes = {panel.name: make_section(panel, page).problem for panel in shown}
    wanted = {panel.name for panel in shown if set(panel.needs) & page.results.problems.keys()}
    assert {name for name, problem in boxes.items() if problem is not None} == wanted
    for panel in shown:
        missing = [name for name in panel.needs if name in page.results.problems]
        assert not missing or boxes[panel.name] == page.results.problems[missing[0]].message()


def test_the_declared_texts_are_on_the_page(results: Path) -> None:
    next_motion = results / "trial-04" / "motion.json"
    text = unescape(trial_page(results / "trial-03", trial=3, experiment="swing", next_motion=next_motion))
    in_plane = TrialPageData(read_results(results / "trial-03"), next_motion=next_motion)
    for panel in (each for each in panels_of("trial") if each.shown(in_plane)):
        for words in (panel.title, panel.caption, panel.good, panel.bad):
            assert words in text


def test_a_panel_without_drawing_has_tables_only() -> None:
    panel = Panel("plain", "Plain", lambda page: PanelContent("Nothing to draw."))
    section = make_section(panel, None)
    assert (section.content.finding, section.markup, section.problem) == ("Nothing to draw.", Markup(), None)


@pytest.mark.parametrize(
    ("masses", "said"),
    [
        ([1.0, 1.0, 1.0], "All points weigh the same."),
        ([1.0, 1.0, 0.5], "All points weigh the same, the free end half as much."),
        ([1.0, 7.0, 0.5], "The heaviest point is m2 = 7 at 200 mm; the experiment names no weight."),
    ],
)
def test_the_page_says_which_point_is_heaviest(masses: list[float], said: str) -> None:
    estimate = SimpleNamespace(string=SimpleNamespace(masses=masses), length_m=0.3, points=3)
    assert parameters._masses_finding(cast(Estimate, estimate), []) == said
