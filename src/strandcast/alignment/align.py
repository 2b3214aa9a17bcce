"""Align one trial: joint log and hand markers to offset and drift with uncertainty, or a refusal."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strandcast.alignment.checks import (
    no_motion_error,
    refuse_few_detections,
    refuse_frame_rate,
    refuse_truncated_log,
    refuse_uncertain,
    refuse_uneven_clock,
    warnings_of,
)
from strandcast.alignment.coarse_search import AlignmentData
from strandcast.alignment.diagnosis import WIDE
from strandcast.alignment.events import (
    FastestPoint,
    VideoEvent,
    pair_events,
    refuse_contradiction,
    robot_events,
)
from strandcast.alignment.fine_fit import Candidate, ClockFit, fit_clock
from strandcast.alignment.led import LedPairs, led_events, pair_led
from strandcast.alignment.log_rows import log_rows_of, motion_span
from strandcast.alignment.problem import ClockProblem, EventPair, Priors
from strandcast.alignment.search import best_fit, fit_with_events
from strandcast.alignment.single_error import with_single_error
from strandcast.alignment.to_record import record_of_events, record_of_fit, sync_check
from strandcast.arm.load import PlanarArm
from strandcast.config.align import AlignSettings
from strandcast.records.alignment import Alignment, SyncCheck
from strandcast.records.joint_log import JointLog, SyncEvent
from strandcast.records.track import DetectedLed
from strandcast.rig.faults import implausible_dimensions, refuse_wrong_dimensions, rig_faults
from strandcast.rig.model import detections_of, rig_of


@dataclass(frozen=True, eq=False)
class VideoData:
    """The results of tracking: columns of markers.parquet, and the LED that the robot switches."""

    markers: dict[str, np.ndarray]
    led: DetectedLed | None = None


@dataclass(frozen=True, eq=False)
class RobotData:
    """The robot's records.

    Attributes
    ----------
    log
        On the controller's clock.
    sync_events
        Events in run.json; those of the log's sync output are added.
    motion_s
        Start and end of the motion; by default from the measured joints.
    file
        The log's file, for messages.
    """

    log: JointLog
    sync_events: Sequence[SyncEvent] = ()
    motion_s: tuple[float, float] | None = None
    file: str | None = None


def align(
    video: VideoData,
    robot: RobotData,
    arm: PlanarArm,
    settings: AlignSettings,
    *,
    experiment: str,
    trial: int,
    tip_speed_m_s: float | None = None,
) -> Alignment:
    """Fit the camera's clock to the robot's.

    Parameters
    ----------
    arm
        Kinematics, and the markers' positions on the hand.
    settings
        The drift's prior, the largest offset, events in the video.
    tip_speed_m_s
        Expected speed of the string's tip, for the cost of an uncertain offset; by default the hand's.

    Raises
    ------
    StrandcastError
        See docs/errors.md, letter A: no markers, no motion, a log that does not fit and why, two offsets that
        fit alike, a sync event that contradicts, an offset too uncertain.
    """
    rig, detections = rig_of(arm), detections_of(video.markers, arm)
    rows = log_rows_of(robot.log, arm, robot.file)
    refuse_few_detections(detections)
    known_drift, drift_sd = settings.drift
    priors = Priors(known_drift=known_drift, drift=drift_sd)
    events = _events(video, robot, settings, trial)
    start_s, end_s = robot.motion_s or motion_span(rows)
    heading = {"experiment": experiment, "trial": trial, "motion_start_s": start_s, "motion_end_s": end_s}
    no_motion = no_motion_error(detections, rows, arm, robot.file)
    if no_motion is not None:
        seen = events.paired(None) or events.led_paired(None).events
        if not seen or no_motion.code != "SC-A008":
            raise no_motion
        return record_of_events(seen, priors, heading)
    files = robot.file, str(arm.path)
    data = AlignmentData(rig, rows, detections, settings.largest_offset_s, arm.joints, *files)
    best = best_fit(data, priors)
    priors = replace(priors, drift=best.fit.drift_prior)
    _refuse_mistakes(best, data, priors)
    best = with_single_error(best, rig, priors)
    fastest = (
        FastestPoint("a tip's", tip_speed_m_s)
        if tip_speed_m_s
        else FastestPoint("the hand's", best.covered.top_speed_m_s())
    )
    pairs, checks, led_warnings = _checked_events(best, events, fastest)
    if pairs:
        best = fit_with_events(best, rig, priors, pairs)
        best = with_single_error(best, rig, priors, pairs)
    else:
        refuse_uncertain(best, fastest)
    faults = rig_faults(best.fit.rig_error, rig, priors)
    warnings = [*warnings_of(best, rig, rows, faults, fastest), *led_warnings]
    return record_of_fit(best, rig, priors, heading, checks, faults, warnings)


@dataclass(frozen=True, eq=False)
class _Events:
    """A trial's events by both clocks: those found by hand in the video, or else the LED's switchings."""

    settings: AlignSettings
    video: list[VideoEvent]
    robot: list[SyncEvent]
    led_video: Sequence[VideoEvent]
    led_robot: list[SyncEvent]
    file: str | None

    @property
    def kinds(self) -> list[str]:
        return [event.kind for event in self.video]

    def paired(self, fit: ClockFit | None) -> list[EventPair]:
        return pair_events(self.video, self.robot, fit, self.file)

    def led_paired(self, fit: ClockFit | None, fastest: FastestPoint | None = None) -> LedPairs:
        if self.settings.led is None:
            return LedPairs()
        return pair_led(self.led_video, self.led_robot, self.settings.led, fit, fastest)


def _events(video: VideoData, robot: RobotData, settings: AlignSettings, trial: int) -> _Events:
    by_hand: list[VideoEvent] = [event for event in settings.sync_events if event.trial == trial]
    return _Events(
        settings,
        by_hand,
        robot_events(robot.log, robot.sync_events),
        [] if by_hand or video.led is None else video.led.events,
        led_events(robot.log, robot.sync_events),
        robot.file,
    )


def _checked_events(
    best: Candidate, events: _Events, fastest: FastestPoint
) -> tuple[tuple[EventPair, ...], list[SyncCheck], list[str]]:
    """Return the events that the fit uses, the comparison of every event with the motion, and warnings.

    An event that contradicts the motion is refused, the LED's are left out.
    """
    by_motion = best.fit if best.determined else None
    pairs = events.paired(by_motion)
    if by_motion is not None:
        refuse_contradiction(pairs, by_motion, events.file)
    led = events.led_paired(by_motion, fastest)
    used = not led.contradicted
    checks = [sync_check(e, best.fit, kind, True) for e, kind in zip(pairs, events.kinds, strict=True)]
    checks += [sync_check(e, best.fit, kind, used) for e, kind in zip(led.events, led.kinds, strict=True)]
    return (*pairs, *(led.events if used else ())), checks, led.warnings


def _refuse_mistakes(best: Candidate, data: AlignmentData, priors: Priors) -> None:
    """Refuse a log, a frame rate or an arm's file that the fit shows to be wrong."""
    rig, offset_s = data.rig, best.fit.offset_s()
    refuse_frame_rate(best.fit, data.detections)
    refuse_uneven_clock(best, data)
    refuse_truncated_log(data, offset_s)
    if implausible_dimensions(best.fit.rig_error, priors):
        free = replace(WIDE, drift=priors.drift)
        wide = fit_clock(ClockProblem.of(rig, best.path, best.covered, offset_s, free))
        refuse_wrong_dimensions(wide.rig_error, wide.rig_error_se, rig, data.joint_names, data.arm_file)
