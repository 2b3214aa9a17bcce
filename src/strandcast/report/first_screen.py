"""What a reader sees first: three numbers, what is doubtful, and what to do next."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from strandcast.errors import StrandcastError
from strandcast.records.estimate import UNDER_PREVIOUS, Estimate
from strandcast.records.motion import Motion
from strandcast.records.verdict import Verdict
from strandcast.report.causes import to_correct_first
from strandcast.report.checks import FAIL, NOT_RUN, NUMBERS, OF_A_CAPTURE, WARN, CheckResult
from strandcast.report.expected import expected_miss
from strandcast.report.measures import best_guess_m, fit_window
from strandcast.report.numbers import UNKNOWN, millimetres
from strandcast.report.results import TrialResults
from strandcast.report.text import uncertain_verdict

MOST_FOUND = 100  # characters of a finding, chosen: the first screen holds a few


class Headline(NamedTuple):
    """One number: what it is, its value, and what that means."""

    name: str
    value: str
    note: str


class Doubts(NamedTuple):
    """What is doubtful, in a sentence that begins with its mark, and its style."""

    style: str
    text: str


class NextStep(NamedTuple):
    """What to do next, in a sentence, and its command if it has one."""

    text: str
    command: str | None = None


def readable_motion(path: Path | None) -> Motion | None:
    """Return a motion; None if there is none or it cannot be read, which the checks say."""
    try:
        return None if path is None else Motion.read(path)
    except StrandcastError:
        return None


def first_figures(results: TrialResults, upcoming: Motion | None) -> list[Headline]:
    """Return the three most important numbers of a trial; `upcoming` is the next motion."""
    if not results.aimed():
        return _of_a_capture(results)
    expected = _of_the_prediction("expected of the next throw", upcoming)
    last = _of_the_fit(results) if expected.value == UNKNOWN else expected
    before = _of_the_prediction("predicted before the throw", results.get("motion"))
    return [_of_the_miss(results.get("verdict")), before, last]


def _of_the_miss(verdict: Verdict | None) -> Headline:
    if verdict is None or verdict.miss_m is None:
        return Headline("miss distance", UNKNOWN, "the closest approach was not seen")
    return Headline(
        "miss distance",
        millimetres(verdict.miss_m, verdict.miss_sigma_m),
        f"± one standard error; a hit is within {millimetres(verdict.hit_radius_m)}",
    )


def _of_the_prediction(name: str, motion: Motion | None) -> Headline:
    expected = expected_miss(motion)
    if expected is None:
        return Headline(name, UNKNOWN, "nothing was predicted")
    return Headline(name, expected.middle(), f"{expected.interval()}; {expected.likely()}")


def _of_the_fit(results: TrialResults) -> Headline:
    estimate = results.get("estimate")
    if estimate is None:
        return Headline("E after the fit", UNKNOWN, "nothing was fitted")
    return Headline("E after the fit", millimetres(estimate.E_m), f"over {fit_window(results)}")


def _of_a_capture(results: TrialResults) -> list[Headline]:
    estimate: Estimate | None = results.get("estimate")
    predicted_m = None if estimate is None else estimate.held_out_m(UNDER_PREVIOUS)
    guess_m = None if estimate is None else best_guess_m(estimate)
    return [
        _of_the_fit(results),
        Headline("E predicted", millimetres(predicted_m), "by the string of the trials before"),
        Headline("E guessed", millimetres(guess_m), "without a model"),
    ]


def doubts(checks: Mapping[str, list[CheckResult]]) -> Doubts:
    """Return what the checks found, by the number that it doubts; keys name trials, "" on their own page."""
    for state, style, mark in ((FAIL, "bad", "✕ Failed"), (WARN, "doubtful", "▲ Doubtful")):
        named: dict[str, list[str]] = {}
        for number in (*NUMBERS, *OF_A_CAPTURE.values()):
            for trial, found in checks.items():
                subject = f"{number} of {trial}" if trial else number
                for each in found:
                    if (each.state, each.doubted) == (state, number):
                        named.setdefault(subject, []).append(_in_words(each))
        if named:
            texts = (f"{subject}: {', '.join(words)}" for subject, words in named.items())
            return Doubts(style, f"{mark} for {'; for '.join(texts)}.")
    states = [each.state for found in checks.values() for each in found]
    idle = states.count(NOT_RUN)
    rest = f"; {idle} had nothing to check" if idle else ""
    return Doubts("sound", f"✓ Nothing doubtful: {len(states) - idle} of {len(states)} checks passed{rest}.")


def _in_words(check: CheckResult) -> str:
    """Return a check and what it found, as long as a line."""
    cut = f"{check.found[:MOST_FOUND].rsplit(' ', 1)[0]} …"
    return f"{check.name} ({check.found if len(check.found) <= MOST_FOUND else cut})"


def next_step(
    results: TrialResults | None, upcoming: Motion | None, command: str | None, thrown: int | None = None
) -> NextStep | None:
    """Return what to do after a trial; `command` plays the next motion, `thrown` is the trial after it.

    None of a capture.
    """
    if results is None or not results.aimed():
        return None
    if thrown is not None:
        return NextStep(f"see trial {thrown}, which was thrown after this one.")
    first = to_correct_first(results)
    if first is not None:
        return NextStep(f"{first}; then throw again.")
    verdict: Verdict | None = results.get("verdict")
    if verdict is not None and verdict.hit and not uncertain_verdict(results):
        return NextStep("nothing, the target is hit.")
    if upcoming is None:
        return NextStep("plan the next motion from this throw.")
    expected = expected_miss(upcoming)
    likely = "" if expected is None else f": {expected.likely()}"
    return NextStep(f"throw trial {upcoming.trial}{likely}.", command)
