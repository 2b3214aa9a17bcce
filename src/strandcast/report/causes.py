"""What most probably went wrong in a throw: the faults that its results prove, each with size and remedy."""

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.record import ARM_FILE, RigFault
from strandcast.records.track import Track
from strandcast.report.numbers import millimetres, milliseconds, percent, place, scaled, significant
from strandcast.report.results import Array, TrialResults

# Chosen so that no good throw of the lab's seven strings is accused; the lab's faults are far beyond.
LEAST_SLIP_M = 0.005  # good throws rise by up to 2 mm: the clamp holds the string beside its centre line
LEAST_SLIP_SHARE = 0.015  # of the length; a stretching cord also rises
SMOOTHED = 7  # frames of the running median, against single misplaced tips
LEAST_RESTING = 10  # frames before the motion
SIGMAS = 5.0
WRONG_RATE = 1e-3  # clocks of cameras and controllers agree to 0.01 %


class Cause(NamedTuple):
    """One probable cause: what it is, its evidence, its cost, what to do, and the anchor of the evidence.

    `first` is what must be done before anything that follows from the throw can be trusted, in a few words;
    `methods` is the sentence that a paper on this throw would need.
    """

    what: str
    evidence: str
    cost: str
    fix: str
    anchor: str
    first: str
    methods: str


class ClampSlip(NamedTuple):
    """How far the tip came beyond the length at rest, that length [m], and when since the motion's start.

    `sigma_m` is the standard deviation of the length from frame to frame.
    """

    rise_m: float
    at_rest_m: float
    sigma_m: float
    since_start_s: float

    @property
    def least_m(self) -> float:
        """Return the rise above which a string slipped: good throws show less [m]."""
        return max(LEAST_SLIP_M, LEAST_SLIP_SHARE * self.at_rest_m, SIGMAS * self.sigma_m)

    @property
    def is_real(self) -> bool:
        """Return whether the rise is beyond what a good throw shows."""
        return self.rise_m > self.least_m


def probable_causes(results: TrialResults) -> list[Cause]:
    """Return the probable causes of a bad throw, the gravest first; none for a good one.

    A cause that cannot be examined, because a result is missing, is left out: the checks say so.
    """
    found: list[Cause] = []
    for test in TESTS:
        try:
            found += test(results)
        except StrandcastError:
            continue
    return found


def to_correct_first(results: TrialResults) -> str | None:
    """Return what must be done before anything that follows from a throw is used; None: nothing."""
    causes = probable_causes(results)
    return f"first {', then '.join(cause.first for cause in causes)}" if causes else None


def caveat(results: TrialResults) -> str | None:
    """Return the words for all that was computed from a throw with faults; None for a throw without."""
    first = to_correct_first(results)
    return None if first is None else f"after the named fault: not to be trusted; {first}"


def clamp_to_tip_m(track: Track) -> Array:
    """Return the straight distance (F,) from the clamp to the tip, NaN where the tip was not detected."""
    return np.asarray(np.linalg.norm(track.points_m[:, -1] - track.points_m[:, 0], axis=1))


def slip_in_clamp(results: TrialResults) -> ClampSlip | None:
    """Return how far the string slipped out of the clamp during the throw; None if rest or throw is not seen.

    The tip is never farther from the clamp than the free length, and a string slips while it is taut: after a
    slip the tip gets farther away than the whole string was long at rest.
    """
    track, alignment = results.need("track"), results.need("alignment")
    time_s = results.robot_time_s()
    reach_m = clamp_to_tip_m(track)
    along_m = np.linalg.norm(np.diff(track.points_m, axis=1), axis=2).sum(axis=1)
    resting = (time_s < alignment.motion_start_s) & np.isfinite(along_m)
    thrown = results.in_window() & np.isfinite(reach_m)
    if resting.sum() < LEAST_RESTING or thrown.sum() < SMOOTHED:
        return None
    # The length along the points, not the straight distance: a string may leave the clamp sideways.
    at_rest_m = float(np.median(along_m[resting]))
    # Of these frames alone: a slip itself makes the length of the whole throw uncertain.
    sigma_m = 1.48 * float(np.median(np.abs(along_m[resting] - at_rest_m)))
    smooth_m = np.median(np.lib.stride_tricks.sliding_window_view(reach_m[thrown], SMOOTHED), axis=1)
    rise_m = float(smooth_m.max()) - at_rest_m
    first = int(np.argmax(smooth_m > at_rest_m + 0.5 * rise_m))
    return ClampSlip(rise_m, at_rest_m, sigma_m, float(time_s[thrown][first] - alignment.motion_start_s))


def slip_words(results: TrialResults) -> str | None:
    """Return the length before and after a slip out of the clamp; None if no slip was found."""
    try:
        slip = slip_in_clamp(results)
    except StrandcastError:
        return None
    if slip is None or not slip.is_real:
        return None
    after_m = slip.at_rest_m + slip.rise_m
    return f"{millimetres(slip.at_rest_m)} at rest → {millimetres(after_m)} after the slip"


def _lost_tip(results: TrialResults) -> Iterator[Cause]:
    verdict, track = results.need("verdict"), results.need("track")
    if verdict.miss_m is not None or verdict.target_m is None:
        return
    time_s, tip = results.robot_time_s(), track.points_m[:, -1]
    early_s = results.need("alignment").motion_end_s - time_s[-1]
    recording, lost_by = ("capture", "the capture") if results.supplied() else ("film", "the tracker")
    if early_s > 0.0:
        yield Cause(
            f"the {recording} ends {milliseconds(early_s, digits=0)} before the motion does",
            f"{verdict.reason}; its last frame is {track.frame[-1]}",
            "miss and hit are unknown; the fit knows the string before that frame alone",
            f"record until the string hangs still again, or copy the whole {recording}. Then throw again",
            "tracking",
            "record the whole throw",
            f"Do not use as a throw with a known miss: the {recording} ends before the motion does.",
        )
        return
    known = np.isfinite(tip).all(axis=1) & (track.flags[:, -1] == 0)
    window = np.flatnonzero(results.in_window())
    lost = window[~known[window]]
    share = percent(len(lost) / max(len(window), 1))
    evidence = (
        f"{verdict.reason}; the tip is missing or doubtful in {share} of the frames from the motion’s start "
        "to 0.3 s after its end"
    )
    gap = _gap_near(known, tip, np.array(verdict.target_m))
    fix = "the string’s end must be in the picture, uncovered and sharp from rest to the target"
    if recording == "capture":
        fix = "two cameras or more must see the string’s end, uncovered, from rest to the target"
    if gap is not None:
        before, after = gap
        start_s = results.need("alignment").motion_start_s
        lasted_s = float(time_s[after] - time_s[before])
        step_s = time_s[before] - time_s[before - 1]
        speed_m_s = float(np.linalg.norm(tip[before] - tip[before - 1]) / step_s)
        beside = np.isfinite(track.points_m[before + 1 : after, 1:-1]).all(axis=2).mean()
        nowhere = int((~np.isfinite(tip[before + 1 : after])).any(axis=1).sum())
        evidence += (
            f". Last seen at {place(tip[before].tolist())}, frame {track.frame[before]}, "
            f"{milliseconds(time_s[before] - start_s, digits=0)} after the motion’s start; seen again "
            f"{milliseconds(lasted_s, digits=0)} later at {place(tip[after].tolist())}. In between "
            f"{percent(float(beside))} of the other points of the string were seen; the tip was not found in "
            f"{nowhere} of the frames between, and doubtful in the other {after - before - 1 - nowhere}"
        )
        evidence += _blur(results, speed_m_s)
        if recording == "film":
            fix = (
                "clear away what stands before or behind the string there, or move the camera so that the "
                "place is in the picture; if the tip is only a streak there, expose for a shorter time with "
                "more light"
            )
        fix = f"look at frames {track.frame[before]} to {track.frame[after]} of the {recording}: {fix}"
    if verdict.wanted is None and results.need("track_summary").choices.get("target_seen") is False:
        evidence += ". The target itself was not found in the picture either: something covers it"
    yield Cause(
        f"{lost_by} lost the string’s tip where it comes nearest to the target",
        evidence,
        "miss and hit are unknown; the fit does not use these frames",
        f"{fix}. Then throw again",
        "tracking",
        "make the tip visible up to the target",
        "Do not use as a throw with a known miss: the tip was not seen at its closest approach.",
    )


def _gap_near(known: Array, tip: Array, target_m: Array) -> tuple[int, int] | None:
    """Return the known frames around the gap that is nearest to the target, or None."""
    rows = np.flatnonzero(known)
    gaps = [(a, b) for a, b in pairwise(rows.tolist()) if b > a + 1]
    away_m = [min(float(np.linalg.norm(tip[k] - target_m)) for k in gap) for gap in gaps]
    return gaps[int(np.argmin(away_m))] if gaps else None


def _blur(results: TrialResults, speed_m_s: float) -> str:
    exposure_s = results.need("track_summary").choices.get("exposure_s")
    if not isinstance(exposure_s, float) or not np.isfinite(speed_m_s):
        return ""
    blur_m = speed_m_s * exposure_s
    speed = f"{significant(speed_m_s, 2)} m/s"
    return f"; the tip’s motion blur was {millimetres(blur_m)} ({speed}) when it was last seen"


def _slip(results: TrialResults) -> Iterator[Cause]:
    slip = slip_in_clamp(results)
    if slip is not None and slip.is_real:
        rise, most_m = millimetres(slip.rise_m, digits=0), slip.at_rest_m + slip.rise_m
        yield Cause(
            f"the string slipped out of the clamp by about {rise} during the throw",
            f"at rest before the throw the string was {millimetres(slip.at_rest_m, slip.sigma_m)} long, from "
            f"clamp to tip along it; from {milliseconds(slip.since_start_s, digits=0)} after the motion’s "
            f"start on, the tip was up to {millimetres(most_m)} away from the clamp, farther than a string "
            "that is held can reach",
            "the fit takes one length for the whole throw: its parameters, the next motion and the places of "
            "the points along the string are wrong",
            "clamp the string harder, exclude this trial (strandcast exclude), measure string.length_m again "
            "and repeat the throw; a rubber-like string that stretches looks the same",
            "slip",
            "clamp the string harder and throw again",
            f"Do not use: the string slipped out of the clamp by {rise} during the throw, and the fit takes "
            "one length for all of it.",
        )


def _wrong_clock(results: TrialResults) -> Iterator[Cause]:
    fit, manifest = results.need("alignment"), results.need("manifest")
    if fit.drift_se is None or abs(fit.drift) < max(WRONG_RATE, SIGMAS * fit.drift_se):
        return
    nominal_hz = manifest.video.frame_rate_hz
    true_hz, true_se_hz = nominal_hz / (1.0 + fit.drift), nominal_hz * fit.drift_se
    nominal, true = f"{nominal_hz:.6g}", f"{true_hz:.6g}"  # finer than clocks drift, and as YAML reads it
    by_hand = scaled(true_hz, 1, 3, "frames/s", true_se_hz)
    drift = scaled(abs(fit.drift), 100, 2, "%", fit.drift_se)
    apart = milliseconds(abs(fit.drift) * (fit.motion_end_s - fit.motion_start_s))
    stated = manifest.video.frame_rate_source == "experiment"
    source = "experiment.yaml" if stated else "the video’s time stamps"
    yield Cause(
        f"the video’s frame rate is wrong: {nominal} frames/s by {source}, {true} by the hand’s motion",
        f"the hand by the camera and by the joint log agree only with the camera’s clock running {drift} "
        f"{'slower' if fit.drift > 0 else 'faster'} than the robot’s (true rate {by_hand}); usual clocks "
        "agree within 0.01 %",
        f"without this correction, video and log would part by {apart} during the motion; it has been "
        "corrected in this fit, and the rate is known only as well as the line above says",
        f"check the rate that the camera was set to and write it: camera.frame_rate_hz: {true}; if it is "
        "right, the log’s time stamps are wrong",
        "clocks",
        f"set camera.frame_rate_hz: {true} and run again",
        f"The frame rate by {source}, {nominal} frames/s, was wrong; all times were corrected to {by_hand}, "
        "the rate by the hand’s motion.",
    )


def length_fault(results: TrialResults) -> RigFault | None:
    """Return what the film says against the declared length; None if nothing, or if the string slipped."""
    if slip_words(results) is not None:
        return None
    faults = results.need("track_summary").faults
    return next((fault for fault in faults if fault.field == "string.length_m"), None)


def arm_faults(results: TrialResults) -> list[RigFault]:
    """Return what the video says against the arm and its files.

    Trials together can tell which number is wrong; one throw alone names that which explains it best.
    """
    fit = results.get("estimate")
    together = None if fit is None else fit.rig_offsets
    alignment = results.get("alignment")
    alone = [] if alignment is None else list(alignment.faults)
    if together is None:
        return alone
    return [*together.faults, *(fault for fault in alone if fault.field != ARM_FILE)]


def _wrong_length(results: TrialResults) -> Iterator[Cause]:
    if (fault := length_fault(results)) is not None:
        yield _named(fault, "the length along the string in this film", "tracking")


def _wrong_weights(results: TrialResults) -> Iterator[Cause]:
    for fault in results.need("estimate").faults:
        yield _named(fault, "the string in the film, and both fits", "fit")


def _wrong_arm(results: TrialResults) -> Iterator[Cause]:
    fit = results.get("estimate")
    offsets = None if fit is None else fit.rig_offsets
    for fault in arm_faults(results):
        evidence = "the hand in this video against its joint log; another number may explain it as well"
        if offsets is not None and fault in offsets.faults:
            together = f"the hand in the videos of trials {', '.join(map(str, offsets.trials))} together"
            evidence = f"{together}, against their joint logs"
        yield _named(fault, evidence, "clocks")


def _named(fault: RigFault, evidence: str, anchor: str) -> Cause:
    """Return a fault that a stage has found as a cause."""
    return Cause(
        fault.what,
        evidence,
        fault.cost,
        fault.fix,
        anchor,
        f"correct {fault.field} and run again",
        f"Known and not corrected: {fault.what}.",
    )


TESTS: tuple[Callable[[TrialResults], Iterator[Cause]], ...] = (
    _lost_tip,
    _slip,
    _wrong_length,
    _wrong_weights,
    _wrong_clock,
    _wrong_arm,
)
