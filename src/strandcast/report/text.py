"""Text made from records: the verdict, the methods paragraph, warnings."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from strandcast.records.alignment import Alignment
from strandcast.records.camera import Camera
from strandcast.records.estimate import UNDER_PREVIOUS, Estimate
from strandcast.records.manifest import Manifest
from strandcast.records.motion import Motion
from strandcast.records.summary import TrialSummary, too_near
from strandcast.records.track import TrackSummary
from strandcast.records.verdict import Verdict
from strandcast.report.causes import probable_causes
from strandcast.report.expected import expected_miss
from strandcast.report.measures import best_guess_m, fit_window
from strandcast.report.numbers import millimetres, place, significant
from strandcast.report.results import FILES, TrialResults

CITATION = (
    "K. Tabata, H. Seki, T. Tsuji and T. Hiramitsu, “Casting Manipulation With Unknown String via Motion "
    "Generation, Actual Manipulation, and Parameter Estimation”, IEEE Access"
)


class Badge(NamedTuple):
    """A state as a word, a shape and a style class."""

    word: str
    shape: str
    style: str


NO_TARGET = Badge("NO TARGET", "○", "unseen")
NOT_READ = Badge("UNKNOWN", "✕", "failed")


def verdict_badge(
    verdict: Verdict | TrialSummary | None, excluded: str | None, *, uncertain: bool = False
) -> Badge:
    """Return the outcome of a trial; word and shape say the same as the colour.

    `uncertain`: the miss is too near to the hit radius, see `too_near`.
    """
    if excluded is not None:
        return Badge("EXCLUDED", "◌", "excluded")
    if verdict is None:
        return NOT_READ
    if isinstance(verdict, Verdict) and verdict.target_m is None:
        return NO_TARGET
    if verdict.miss_m is None:
        return Badge("NOT SEEN", "◇", "unseen")
    if uncertain:
        return Badge("HIT?" if verdict.hit else "MISS?", "◐", "doubtful")
    return Badge("HIT", "●", "hit") if verdict.hit else Badge("MISS", "▲", "miss")


def uncertain_verdict(results: TrialResults) -> bool:
    """Return whether a miss is too near to the hit radius."""
    verdict: Verdict | None = results.get("verdict")
    return verdict is not None and too_near(verdict, verdict.hit_radius_m)


def missed_from(verdict: Verdict) -> str:
    """Return in words what the miss is measured from."""
    if verdict.wanted is not None:
        return f"{verdict.wanted}; a shortfall in direction, speed or height counts as metres"
    if verdict.bar_m is None:
        return f"the target at {place(verdict.target_m)}"
    return f"the bar from {place(verdict.bar_m[0])} to {place(verdict.bar_m[1])}"


def miss_in_words(verdict: Verdict) -> str:
    """Return the miss and what it is measured from."""
    miss = millimetres(verdict.miss_m)
    if verdict.wanted is not None:
        return f"the aim was {'reached to within' if verdict.hit else 'missed by'} {miss}"
    return f"{miss} from {missed_from(verdict)}"


def outcome(results: TrialResults) -> str:
    """Return the verdict in a sentence or two: the miss with its uncertainty, and whether it was expected."""
    verdict: Verdict | None = results.get("verdict")
    if verdict is None:
        return "Whether the tip hit is unknown."
    if verdict.target_m is None:
        return _as_fitted(results)
    aim = missed_from(verdict) if verdict.wanted is None else "the aim"
    target = f"{aim[0].upper()}{aim[1:]}"
    if verdict.miss_m is None:
        return f"{target}: the closest approach was not seen; {verdict.reason}."
    miss = millimetres(verdict.miss_m, verdict.miss_sigma_m)
    if not verdict.hit:
        text = f"{target} was missed by {miss}"
    elif verdict.wanted is None:
        text = f"The tip passed {miss} from {aim}"
    else:
        text = f"{target} was reached to within {miss}"
    motion: Motion | None = results.get("motion")
    aimed = motion is None or motion.target_m == verdict.target_m
    expected = expected_miss(motion) if aimed else None
    beyond_m = verdict.miss_m - verdict.hit_radius_m
    text += f", {millimetres(abs(beyond_m))} {'outside' if beyond_m > 0 else 'inside'} the hit radius"
    if uncertain_verdict(results):
        text += ", too near to its edge to be certain"
    text += "" if expected is None else f"; {expected.compared(verdict.miss_m)}"
    if aimed or motion is None:
        return f"{text}."
    return f"{text}. The motion was planned for another target, at {place(motion.target_m)}."


def _as_fitted(results: TrialResults) -> str:
    """Return in words how well a trial without a target was fitted, or that it was not."""
    estimate = results.get("estimate")
    if estimate is None:
        return "The trial has no target, and was not fitted."
    return f"A capture without a target: {capture_finding(estimate, fit_window(results))}"


def capture_finding(estimate: Estimate, window: str) -> str:
    """Return how well a trial without a target was fitted, and predicted by the trials before it."""
    fitted = f"E {millimetres(estimate.E_m, digits=2)} after the fit, over {window}"
    predicted_m, guess_m = estimate.held_out_m(UNDER_PREVIOUS), best_guess_m(estimate)
    if predicted_m is not None:
        predicted = millimetres(predicted_m, digits=2)
        fitted += f". The string fitted to the trials before it predicted it to {predicted}"
    if guess_m is not None:
        fitted += f"; the better of two guesses without a model is {millimetres(guess_m, digits=2)} off"
    read = estimate.fitted_in_words()
    return f"{fitted}." if read is None else f"{fitted}. The fit read {read} of its trials."


def warnings_of(results: TrialResults) -> list[tuple[str, str]]:
    """Return the warnings of all records, each with its file."""
    warnings = []
    for name in ("manifest", "camera", "track_summary", "alignment", "estimate"):
        record = results.get(name)
        warnings += [(FILES[name], text) for text in (record.warnings if record is not None else [])]
    motion = results.get("motion")
    if motion is not None and motion.provenance is not None and results.aimed():
        warnings += [(FILES["motion"], f"planner's flag: {flag}") for flag in motion.provenance.flags]
    return warnings


def methods(results: TrialResults) -> str:
    """Return a paragraph for a paper, named faults first; a stage without results is left out."""
    sentences = [cause.methods for cause in probable_causes(results)]
    sentences += [
        sentence(record) for name, sentence in SENTENCES.items() if (record := results.get(name)) is not None
    ]
    what = "The loop is" if results.aimed() else "The string model is"
    sentences.append(
        f"{what} that of {CITATION}, as implemented by strandcast; procedures are named above "
        "(“paper” is the paper's own procedure, every other name strandcast's); every E is unweighted (w = "
        "0) unless stated otherwise."
    )
    # The versions that made the last of the results.
    sentences.append(software_sentence(next(filter(None, reversed(results.made_by.values())), {})))
    return " ".join(sentence for sentence in sentences if sentence)


def software_sentence(versions: Mapping[str, str]) -> str:
    """Return the versions in a sentence; nothing if none is known."""
    named = ", ".join(f"{name} {version}" for name, version in versions.items())
    return f"Software: {named}." if named else ""


def _recording(manifest: Manifest) -> str:
    video, log = manifest.video, manifest.joint_log
    joints = "" if log is None else f", the joints at {log.rate_hz:g} Hz"
    rounded = video.rounded_to_s
    clock = "" if rounded is None else f" (the even clock of time stamps rounded to {1e3 * rounded:.3g} ms)"
    return (
        f"The throw was recorded at {video.frame_rate_hz:.6g} frames/s{clock} and {video.width_px} × "
        f"{video.height_px} px ({video.codec}){joints}."
    )


def _camera(camera: Camera) -> str:
    return (
        f"Lens and plane of motion were calibrated ({camera.source}) to {camera.lens.rms_px:.2f} px and "
        f"{camera.plane_rms_px:.2f} px rms; one pixel is {camera.scale_m_per_px * 1e3:.2f} mm."
    )


def _tracking(summary: TrackSummary) -> str:
    length, share = f"{summary.length_m * 1e3:.0f} mm", f"{summary.tracked_fraction * 100:.1f} %"
    if "point_1_place_m" in summary.choices:
        text = (
            f"{summary.points} markers on the string of {length} were captured; {share} of their positions "
            "were measured"
        )
    else:
        text = (
            f"The string of {length} was represented by {summary.points} mass points; {share} of them were "
            "detected without a flag"
        )
    return f"{text} (median σ {summary.median_sigma_m * 1e3:.2f} mm)."


def _clocks(alignment: Alignment) -> str:
    if alignment.offset_se_s is None:
        return ""
    error_ms = alignment.offset_se_s * 1e3
    clock = "Capture" if alignment.source == "supplied" else "Camera"
    aligned = f"{clock} and robot clocks were aligned by the hand's path"
    return f"{aligned} to ± {error_ms:.2f} ms (standard error)."


def _fit(estimate: Estimate) -> str:
    change = estimate.step_change_m
    trials = "trial" if len(estimate.trials_used) == 1 else "trials"
    halved = "" if change is None else f" (halved, the string moves by {significant(1e3 * change)} mm)"
    return (
        f"String parameters and relative masses ({estimate.points} mass points) were estimated from "
        f"{trials} {', '.join(map(str, estimate.trials_used))} by {estimate.search} ({estimate.evaluations} "
        f"simulations, ranges “{estimate.ranges}”, reading “{estimate.reading}”, "
        f"steps of {estimate.dt_s * 1e3:g} ms{halved}, "
        f"start shape {estimate.start_shape}, evaluation in the {estimate.evaluation} frame, "
        f"w = {estimate.w:g}, seed {estimate.seed}); E = {significant(estimate.E_m * 1e3)} mm."
    )


def _planning(motion: Motion) -> str:
    if motion.provenance is None:
        return ""
    planned = f"The motion was planned by “{motion.provenance.planner}”."
    if motion.provenance.kind != "rehearsed":
        return planned
    return (
        f"{planned} Before the first throw, it was played with an empty clamp, and planned again with the "
        "joints' measured error."
    )


# Sentence of the methods paragraph by the result that it describes.
SENTENCES: dict[str, Callable[[Any], str]] = {
    "motion": _planning,
    "manifest": _recording,
    "camera": _camera,
    "track_summary": _tracking,
    "alignment": _clocks,
    "estimate": _fit,
}
