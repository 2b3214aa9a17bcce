"""The paper's experiment in numbers and as a page, from five small runs."""

import re
from html.parser import HTMLParser

import pytest

from strandcast.errors import StrandcastError
from strandcast_studies.paper.figures.cost import FirstFit, _rank_correlation, warned
from strandcast_studies.paper.figures.masses import FoundMass, _mass, found_masses
from strandcast_studies.paper.figures.parameters import several_targets
from strandcast_studies.paper.figures.throws import first_and_last
from strandcast_studies.paper.figures.words import READINGS
from strandcast_studies.paper.report.facts import PaperFacts
from strandcast_studies.paper.report.page import paper_page
from strandcast_studies.paper.report.runs import RunResults, to_show
from strandcast_studies.paper.report.summary import chosen, misses_of, summarise_paper

SECTIONS = {
    *("trials", "rates", "misses", "strings", "targets", "masses", "parameters", "transfer", "warning"),
    *("budget", "readings", "times", "runs", "provenance"),
    *("strobe-1-paper", "strobe-1-default", "strobe-5-default", "strobe-7-default"),
    *("tip-default", "hand-default", "joints-default", "tip-paper", "hand-paper", "joints-paper"),
}


class Text(HTMLParser):
    """The texts of a page by table row, and its tags."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.inside = False  # a cell
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
            self.inside = True

    def handle_endtag(self, tag):
        self.inside = self.inside and tag not in ("td", "th")

    def handle_data(self, data):
        if self.inside:
            self.rows[-1][-1] += data.strip()


@pytest.fixture(scope="module")
def page(paper):
    return paper_page(*paper)


@pytest.fixture(scope="module")
def runs(paper):
    summary, folders, _ = paper
    return [RunResults(run, folders[run.experiment]) for run in summary.experiments]


def rows(page: str, *begin: str) -> list[list[str]]:
    """Return the table rows that begin with these cells."""
    return [row for row in Text(page).rows if row[: len(begin)] == list(begin)]


@pytest.mark.thorough
def test_unfinished_runs_do_not_count_and_failed_ones_do(paper):
    summary = paper[0]
    assert [run.string for run in chosen(summary.experiments, "default", "own")] == [1, 5]
    lines = {(line.method, line.over, line.radius_m, line.trial): line for line in summary.rates}
    assert (lines["default", "own", 0.02, 2].hits, lines["default", "own", 0.02, 2].runs) == (0, 2)
    assert (lines["default", "own", 0.02, 3].hits, lines["default", "own", 0.02, 3].share) == (1, 0.5)
    assert lines["default", "all", 0.02, 3].runs == 3
    assert lines["paper", "own", 0.02, 3].hits == 0
    thrown = {(line.method, line.over, line.of, line.trial): line for line in summary.misses}
    hit = summary.experiments[1]
    assert thrown["default", "own", "thrown", 3].median_m == hit.trials[2].miss_m
    assert thrown["default", "own", "nearest", 3].unknown == 1  # the failed run never threw


@pytest.mark.thorough
def test_an_excluded_trial_is_no_miss(paper):
    line = paper[0].experiments[1].trials[0]
    out = line.model_copy(update={"excluded": "slipped"})
    assert misses_of([line, out]) == [line.miss_m, None]
    assert summarise_paper([], 0.02).rates == []


@pytest.mark.thorough
def test_every_section_is_there_and_only_runs_that_are_not_done_have_boxes(page):
    found = [attributes["id"].removesuffix("-title") for tag, attributes in Text(page).tags if tag == "h2"]
    assert set(found) == SECTIONS
    assert len(found) == len(SECTIONS)
    boxes = re.findall(r'<div id="([a-z0-9-]+)">\s*<div class="box"', page)
    assert boxes == ["strobe-5-default", "strobe-7-default"]
    assert page.count("<svg role") >= 15


def test_nothing_comes_from_outside(page):
    tags = Text(page).tags
    assert not [tag for tag, _ in tags if tag in ("script", "link", "iframe", "object")]
    links = [a.get("src") or a.get("href") or "" for _, a in tags]
    assert not [link for link in links if "//" in link]
    ids = [a["id"] for _, a in tags if a.get("id")]
    assert len(ids) == len(set(ids))
    assert {link[1:] for link in links if link.startswith("#")} <= set(ids)


@pytest.mark.thorough
def test_the_same_results_give_the_same_bytes(page, paper):
    assert paper_page(*paper) == page


def test_table_3_is_compared_with_the_papers(page, paper):
    one, other = rows(page, "1", "1", "2"), rows(page, "1", "2", "–")
    nearest = min(trial.miss_m for trial in paper[0].experiments[0].trials)
    assert one[0][3:] == [f"×\u00a02 ({1e3 * nearest:.0f}\u00a0mm)", "3"]
    assert other[0][3] == ""
    assert other[0][4].startswith("×\u00a02")
    assert rows(page, "5", "3", "3")[0][4] == "✕ failed"
    assert rows(page, "7", "4", "2")[0][4] == "unfinished"
    assert '<a href="../paper-string1-target1-seed101-default/report.html">3</a>' in page


def test_failures_are_shown_with_their_escaped_reason(page):
    assert "2 of 5 runs are not complete" in page
    assert "SC-V005 ERROR  the string &lt;slipped&gt;" in page


def test_each_fit_on_the_other_targets_throw(page):
    assert rows(page, "target 1, trial 3")[0][1:] == [
        "2.0\u00a0mm (2.0 … 3.0)",
        "6.0\u00a0mm (6.0 … 7.0)",
    ]
    assert "2.5\u00a0mm against 6.5\u00a0mm" in page


def test_wall_times_by_stage(page):
    assert rows(page, "track")[0] == ["track", "2", "25.0 (30.0)", "14.0 (14.0)"]


def test_masses_are_in_plain_points(runs, paper):
    strings = paper[2].strings
    estimate = runs[1].estimate()
    assert found_masses(estimate, strings[1]) == [FoundMass(0.3, None, 38.0)]
    scaled = estimate.model_copy(update={"options": {"plain_mass": 4.0}})
    assert found_masses(scaled, strings[1])[0].ratio == 9.5
    weight = estimate.weights[0]
    stiff = [weight.model_copy(update={"kind": "stiff", "place_m": place}) for place in (0.39, 0.42)]
    both = found_masses(estimate.model_copy(update={"weights": [weight, *stiff]}), strings[5])
    assert _mass(both, strings[5], "pipe", 0) == 76.0
    assert _mass(both, strings[5], "weight", 0) == 38.0


def test_a_run_with_a_before_and_an_after_is_shown(runs):
    assert to_show(runs, 1, "default") is runs[1]
    with pytest.raises(StrandcastError, match="no finished run of string 5 by defaults"):
        to_show(runs, 5, "default")
    at_once = RunResults(runs[1].run.model_copy(update={"hit_trial": 1, "seed": 100}), runs[1].folder)
    assert to_show([at_once, runs[1]], 1, "default") is runs[1]
    assert [each.run.target for each in several_targets(runs, "default")] == [1, 2]


def test_the_first_fit_and_the_next_miss(paper):
    (first, second) = paper[0].experiments[1].trials[:2]
    assert FirstFit(first.E_m, second.miss_m) in warned(paper[0], "default")
    rising = [FirstFit(E, E**2) for E in (0.001, 0.002, 0.004, 0.003)]
    assert _rank_correlation(rising) == pytest.approx(1.0)
    assert _rank_correlation([FirstFit(w.E_m, -w.miss_m) for w in rising]) == pytest.approx(-1.0)


def test_after_a_hit_at_once_the_second_throw_is_shown_beside_it(runs):
    at_once = RunResults(runs[1].run.model_copy(update={"hit_trial": 1}), runs[1].folder)
    shown = first_and_last(at_once)
    assert "Hit at trial 1. Trials 1 and 2;" in shown.finding


def test_the_budget_gives_the_share_of_each_cause_and_the_causes_of_the_worst_throws(page):
    (line,) = rows(page, "without servo")
    assert line[1:] == ["5.0\u00a0mm", "10.0\u00a0mm", "8.0\u00a0mm", "−1.0\u00a0mm"]
    worst, next_worst = rows(page, "1", "0", "12.0\u00a0mm") + rows(page, "1", "1", "3.0\u00a0mm")
    assert worst[-1] == "servo"
    assert next_worst[-1] == "none alone"


def test_readings_hold_the_settings_of_both_methods(page):
    assert any("w = 0.1;" in cell for row in rows(page, "Eqs. 5, 6") for cell in row)
    assert ["method", "paper", "–"] in rows(page, "method")


def test_a_page_without_throws_says_so(paper):
    page = paper_page(summarise_paper([], 0.02), {}, PaperFacts())
    assert "Nothing has been thrown yet" in page
    assert len(READINGS) > 20
