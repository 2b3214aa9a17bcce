"""What a reader sees first: verdict, picture, three numbers, doubts and the next step, in a real browser."""

from dataclasses import replace
from pathlib import Path

import pytest

from strandcast.core.trial_names import trial_name
from strandcast.records.files import write_text
from strandcast.records.motion import Motion
from strandcast.report.checks import (
    FAIL,
    NEXT_MOTION,
    NEXT_THROW,
    NOT_RUN,
    PASS,
    WARN,
    CheckResult,
    run_checks,
)
from strandcast.report.experiment_page import experiment_page
from strandcast.report.first_screen import doubts, next_step
from strandcast.report.panels.page_data import ExperimentPageData
from strandcast.report.results import read_results
from strandcast.report.summary import summarise

from .chromium import Browser

WIDTH_PX, HEIGHT_PX = 1366, 768
# Where elements end, from the top of the page.
ENDS = "[...document.querySelectorAll('{}')].map(each => each.getBoundingClientRect().bottom + scrollY)"
SHOWN = "document.getElementById('{}').checkVisibility({{contentVisibilityAuto: true}})"


@pytest.fixture(scope="module")
def page(drawn: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("first") / "report.html"
    write_text(path, drawn)
    return path


def test_the_first_screen_has_verdict_picture_numbers_and_the_next_step(page: Path, browser: Browser) -> None:
    with browser.page(page, width=WIDTH_PX, height=HEIGHT_PX) as opened:
        for selector, count in ((".chip", 1), (".first svg.picture", 1), (".first dd", 3), (".next", 1)):
            ends = opened.value(ENDS.format(selector))
            assert (selector, len(ends)) == (selector, count)
            assert max(ends) < HEIGHT_PX, selector
        assert opened.value("document.documentElement.scrollHeight") <= 12 * HEIGHT_PX


def test_a_link_unfolds_what_it_leads_to(page: Path, browser: Browser) -> None:
    with browser.page(page, width=WIDTH_PX, height=HEIGHT_PX) as opened:
        assert not opened.value(SHOWN.format("checks"))
        opened.value("document.querySelector('a[href=\"#checks\"]').click()")
        opened.wait(SHOWN.format("checks"))


def checks_of(*states: str) -> list[CheckResult]:
    return [CheckResult(f"check {k}", state, f"{k} mm", "") for k, state in enumerate(states)]


def test_what_is_doubtful_is_said_by_name_the_gravest_first():
    sound = doubts({"": checks_of(PASS, PASS, NOT_RUN)})
    assert sound == ("sound", "✓ Nothing doubtful: 2 of 3 checks passed; 1 had nothing to check.")
    assert doubts({"": checks_of(PASS, WARN)}) == ("doubtful", "▲ Doubtful for the miss: check 1 (1 mm).")
    long = doubts({"": [CheckResult("check", WARN, "word " * 40, "")]}).text
    assert long.endswith("word word …).")
    assert len(long) < 140
    both = doubts({"trial 1": checks_of(WARN), "trial 2": checks_of(PASS, FAIL, FAIL)})
    assert both == ("bad", "✕ Failed for the miss of trial 2: check 1 (1 mm), check 2 (2 mm).")


def test_each_doubt_says_which_number_it_doubts(results: Path) -> None:
    miss, other = checks_of(WARN, WARN)
    found = doubts({"": [other._replace(doubted=NEXT_THROW), miss]}).text
    assert found == "▲ Doubtful for the miss: check 0 (0 mm); for the next throw: check 1 (1 mm)."
    trial = read_results(results / "trial-03")
    track, fit = (
        trial.need(name).model_copy(update={"warnings": [f"of the {name}"]})
        for name in ("track_summary", "estimate")
    )
    trial = replace(trial, pieces=trial.pieces | {"track_summary": track, "estimate": fit})
    words = doubts({"": run_checks(trial, None)}).text
    before, _, after = words.partition("for the next throw: ")
    assert "of the track_summary" in before.partition("for the predicted miss")[0]
    assert "of the estimate" in after


def test_the_experiments_page_says_which_trial_is_doubtful(results: Path) -> None:
    trials = {trial: results / trial_name(trial) for trial in (1, 2, 3)}
    given = {"string_length_m": 0.3, "target_m": [0.606, 0.674], "hit_radius_m": 0.02}
    header = experiment_page(summarise("swing", trials, **given), trials).partition("</header>")[0]
    assert '<p class="doubtful">▲ Doubtful for the ' in header
    assert " of trial 1: warnings of the stages" in header
    assert header.count("<dd>") == 3


def test_the_experiments_page_doubts_the_next_motion_and_the_trial_before(
    results: Path,
) -> None:
    trials = {trial: read_results(results / trial_name(trial)) for trial in (1, 2, 3)}
    given = {"string_length_m": 0.3, "target_m": [0.606, 0.674], "hit_radius_m": 0.02}
    summary = summarise("swing", {trial: each.folder for trial, each in trials.items()}, **given)
    checks = ExperimentPageData(summary, trials, next_motion=results / "gone.json").checks
    assert [each[-1].name == NEXT_MOTION for each in checks.values()] == [False, False, True]
    assert checks[3][-1].state == FAIL
    since = {trial: any("trial before" in each.name for each in found) for trial, found in checks.items()}
    assert since == {1: False, 2: True, 3: True}


def test_the_next_step_follows_the_verdict(results: Path) -> None:
    trial, upcoming = read_results(results / "trial-03"), Motion.read(results / "trial-04" / "motion.json")
    verdict = trial.need("verdict")

    def said(hit: bool, miss_m: float | None, motion: Motion | None, thrown: int | None = None) -> str:
        given = verdict.model_copy(update={"hit": hit, "miss_m": miss_m})
        return next_step(replace(trial, pieces=trial.pieces | {"verdict": given}), motion, "play", thrown)

    assert said(True, 0.001, upcoming) == ("nothing, the target is hit.", None)
    text, command = said(True, verdict.hit_radius_m, upcoming)  # may as well be a miss
    assert text.startswith("throw trial 4")
    assert command == "play"
    assert said(False, 0.1, upcoming).command == "play"
    assert "plan the next motion" in said(False, 0.1, None).text
    assert said(False, 0.1, upcoming, thrown=4).text == "see trial 4, which was thrown after this one."
