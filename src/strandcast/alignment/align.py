"""Align one trial: joint log and hand markers to offset, drift and their certainty, or a refusal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strandcast.alignment.checks import (
    LEAST_SIGHTINGS,
    NORMAL,
    PLAIN_RESIDUAL_M,
    outside,
    refuse_constants,
    refuse_cut,
    refuse_few,
    refuse_rate,
    refuse_unsure,
    still,
    suspicious,
    warnings_of,
)
from strandcast.alignment.diagnosis import WIDE, Trial, offset_window, why_not
from strandcast.alignment.events import (
    SeenEvent,
    clock_of_events,
    pair,
    refuse_contradiction,
    robot_events,
)
from strandcast.alignment.fit import SHIFT_S, Candidate, ClockFit, fit_clock, moving_rms_m
from strandcast.alignment.joints import joint_path
from strandcast.alignment.led import Led, LedPairs, led_events, pair_led
from strandcast.alignment.problem import Event, Priors
from strandcast.alignment.rig import Rig, Seen, rig_of, seen_of
from strandcast.alignment.rows import motion_span, rows_of
from strandcast.alignment.search import APART_S, candidate_offsets, shape_m
from strandcast.arm.load import Arm
from strandcast.errors import StrandcastError
from strandcast.records.alignment import Alignment, MarkerFit, SyncCheck
from strandcast.records.joint_log import JointLog, SyncEvent

LARGEST_RESIDUAL_M = 0.005
LARGEST_COARSE_M = 0.05
RIVAL_RATIO = 1.5
SURPRISE = 4.0  # standard deviations of the drift's prior
ANY_DRIFT = 0.05
FREED_SHARE = 0.7  # of the residual that a free drift must leave
LEAST_SHARE = 0.5  # of the way in the video that a rival must explain


def align(
    markers: dict[str, np.ndarray],
    log: JointLog,
    arm: Arm,
    *,
    experiment: str,
    trial: int,
    motion_s: tuple[float, float] | None = None,
    priors: Priors | None = None,
    largest_offset_s: float | None = None,
    seen_events: list[SeenEvent] | None = None,
    told_events: list[SyncEvent] | None = None,
    led: Led | None = None,
    tip_speed_m_s: float | None = None,
    log_file: str | None = None,
) -> Alignment:
    """Fit the camera's clock to the robot's.

    Parameters
    ----------
    markers
        Columns of markers.parquet: the hand's markers as the video saw them, in the motion plane.
    log
        The joint log, on the controller's clock.
    arm
        Kinematics, and the markers' places on the hand.
    experiment, trial
        Whose record it is.
    motion_s
        Start and end of the motion on the robot's clock; found from the measured joints if not given.
    priors
        Of drift and of the rig's constant errors.
    largest_offset_s
        How far the video's first frame may lie from the log's first row; None: anywhere they can overlap.
    seen_events, told_events
        Sync events in the video, and those that run.json tells beside the log's own.
    led
        An LED's switchings in the video; left out where there are `seen_events`.
    tip_speed_m_s
        How fast the string's tip is expected to be, for what an unsure offset costs; by default the hand's.
    log_file
        For messages.

    Raises
    ------
    StrandcastError
        SC-A001 … SC-A021, see docs/alignment.md: no markers, no motion, a log that does not fit and why, two
        offsets that fit alike, a sync event that contradicts, an offset too unsure.
    """
    priors = priors or Priors()
    rig, seen, rows = rig_of(arm), seen_of(markers, arm), rows_of(log, arm, log_file)
    refuse_few(seen)
    events = seen_events or []
    there = robot_events(log, told_events or [])
    lit = led_events(log, told_events or [])
    led = Led([]) if led is None or events else led
    motion = motion_s or motion_span(rows)
    nothing = still(seen, rows, arm, log_file)
    if nothing is not None:
        alone = pair(events, there, None, log_file) or pair_led(led, lit, None, 0.0, "").events
        if not alone or nothing.code != "SC-A005":
            raise nothing
        return _by_events(alone, priors, experiment, trial, motion)
    best = _best(Trial(rig, rows, seen, arm.joints, largest_offset_s), priors, log_file, str(arm.path))
    refuse_rate(best.fit, seen)
    refuse_cut(rows, seen, seen.time_s + best.fit.offset_s(), log_file)
    if suspicious(best.fit, priors):
        wide = fit_clock(rig, best.path, best.covered, best.fit.offset_s(), replace(WIDE, drift=priors.drift))
        refuse_constants(wide, rig, arm.joints, str(arm.path))
    pairs = pair(events, there, best.fit if best.told else None, log_file)
    if best.told:
        refuse_contradiction(pairs, best.fit, log_file)
    whose, speed_m_s = (
        ("a tip's", tip_speed_m_s) if tip_speed_m_s else ("the hand's", _top_speed(best.covered))
    )
    by_led = pair_led(led, lit, best.fit if best.told else None, speed_m_s, whose)
    checks = [
        *(_check(event, best.fit, kind.kind, True) for event, kind in zip(pairs, events, strict=True)),
        *_led_checks(by_led, best.fit),
    ]
    pairs += [] if by_led.denied else by_led.events
    if pairs:
        best = _with_events(best, rig, priors, tuple(pairs))
    else:
        refuse_unsure(best, speed_m_s, whose)
    told = [*warnings_of(best, rig, rows, priors, speed_m_s, whose), *by_led.warnings]
    return _record(best, rig, priors, experiment, trial, motion, checks, told)


def _best(trial: Trial, priors: Priors, file: str | None, arm_file: str) -> Candidate:
    """Return the best fit of all offsets.

    Raises
    ------
    StrandcastError
        None covers the sightings, none fits (with the mistake that explains it), or two fit alike.
    """
    window = offset_window(trial.rows, trial.seen, trial.largest_offset_s)
    offsets, coarse_m = candidate_offsets(trial.rig, trial.rows.time_s, trial.rows.q_rad, trial.seen, window)
    if coarse_m[0] > LARGEST_COARSE_M:
        raise why_not(trial, float(coarse_m[0]), file, arm_file)
    near = offsets[coarse_m <= max(3.0 * coarse_m[0], 0.01)]
    fits = [found for offset_s in near if (found := _fitted(trial, float(offset_s), priors)) is not None]
    if not fits:
        raise outside(file)
    # Where log and video hardly overlap, the hand rests in both, and anything fits.
    shares = [float(found.covered.speed_m_s().sum()) for found in fits]
    fits = [found for found, share in zip(fits, shares, strict=True) if share >= LEAST_SHARE * max(shares)]
    fits.sort(key=lambda found: found.residual_m)
    if fits[0].residual_m > LARGEST_RESIDUAL_M:
        raise why_not(trial, fits[0].residual_m, file, arm_file)
    _refuse_rivals(fits)
    return fits[0]


def _fitted(trial: Trial, offset_s: float, priors: Priors) -> Candidate | None:
    """Fit about one offset; with any drift, where the expected one does not do."""
    rows = trial.rows
    covered = trial.seen.where(rows.covers(trial.seen.time_s + offset_s))
    if len(covered.time_s) < LEAST_SIGHTINGS:
        return None
    robot_s = covered.time_s + offset_s
    path = joint_path(rows.time_s, rows.q_rad, (float(robot_s[0]), float(robot_s[-1])))
    fit = fit_clock(trial.rig, path, covered, offset_s, priors)
    shape = shape_m(trial.rig, rows, covered, offset_s, SHIFT_S)
    found = Candidate(fit, covered, path, moving_rms_m(fit.residual, covered, fit.wrong), shape)
    surprise = abs(fit.drift - priors.known_drift) > SURPRISE * priors.drift
    if priors.drift < ANY_DRIFT and (surprise or found.residual_m > PLAIN_RESIDUAL_M):
        fit = fit_clock(trial.rig, path, covered, offset_s, replace(priors, drift=ANY_DRIFT))
        freed = Candidate(fit, covered, path, moving_rms_m(fit.residual, covered, fit.wrong), shape)
        if freed.residual_m < FREED_SHARE * found.residual_m or surprise:
            return freed
    return found


def _with_events(best: Candidate, rig: Rig, priors: Priors, events: tuple[Event, ...]) -> Candidate:
    start_s = best.fit.offset_s() if best.told else events[0].robot_s - events[0].camera_s
    fit = fit_clock(rig, best.path, best.covered, start_s, priors, events)
    return replace(best, fit=fit, residual_m=moving_rms_m(fit.residual, best.covered, fit.wrong))


def _refuse_rivals(fits: list[Candidate]) -> None:
    best = fits[0]
    for rival in fits[1:] if best.told else ():
        apart_s = abs(rival.fit.offset_s() - best.fit.offset_s())
        if apart_s > APART_S and rival.residual_m < RIVAL_RATIO * best.residual_m:
            raise StrandcastError(
                "SC-A009",
                f"two offsets, {best.fit.offset_s():.3f} and {rival.fit.offset_s():.3f} s, fit alike "
                f"({best.residual_m * 1e3:.1f} and {rival.residual_m * 1e3:.1f} mm): the motion repeats"
                " itself",
                field="align.largest_offset_s",
                fix="play a motion that does not repeat itself, or say how far apart recordings may begin",
            )


def _top_speed(seen: Seen) -> float:
    return float(np.quantile(seen.speed_m_s(), 0.98))


def _led_checks(led: LedPairs, fit: ClockFit) -> list[SyncCheck]:
    return [
        _check(event, fit, kind, not led.denied) for event, kind in zip(led.events, led.kinds, strict=True)
    ]


def _check(event: Event, fit: ClockFit, kind: str, used: bool) -> SyncCheck:
    told_s = fit.told_s(event.camera_s)
    return SyncCheck(
        camera_time_s=event.camera_s,
        robot_time_s=event.robot_s,
        sigma_s=event.sigma_s,
        difference_s=told_s - event.robot_s,
        motion_se_s=fit.told_se_s(event.camera_s),
        kind=kind,
        used=used,
    )


def _record(
    best: Candidate,
    rig: Rig,
    priors: Priors,
    experiment: str,
    trial: int,
    motion_s: tuple[float, float],
    checks: list[SyncCheck],
    warnings: list[str],
) -> Alignment:
    fit, misfit, covered = best.fit, best.fit.misfit, best.covered
    return Alignment(
        experiment=experiment,
        trial=trial,
        source="fit",
        offset_s=fit.offset_s(),
        offset_se_s=fit.offset_se_s(),
        drift=fit.drift,
        drift_se=fit.drift_se,
        drift_prior=priors.drift,
        known_drift=priors.known_drift,
        residual_rms_m=best.residual_m,
        frames=len(np.unique(covered.time_s)),
        motion_start_s=motion_s[0],
        motion_end_s=motion_s[1],
        marker_shift_m=misfit.shift_m.mean(axis=0).tolist(),
        marker_turn_rad=float(misfit.turn_rad.mean()),
        base_shift_m=misfit.base_m.tolist(),
        joint_zero_rad=misfit.zero_rad.tolist(),
        link_length_m=misfit.length_m.tolist(),
        stretch=misfit.stretch.tolist(),
        markers=[
            MarkerFit(
                marker=name,
                shift_m=misfit.shift_m[index].tolist(),
                turn_rad=float(misfit.turn_rad[index]),
                sightings=int((covered.marker == index).sum()),
                wrong=int(fit.wrong[covered.marker == index].sum()),
            )
            for index, name in enumerate(rig.ids)
        ],
        middle_se_s=fit.middle_se_s,
        middle_camera_time_s=fit.middle_camera_s,
        unaided_se_s=fit.unaided_se_s,
        slow_error_m=fit.slow_m,
        wrong_rows=int(best.path.wrong.sum()),
        sync_events=checks,
        warnings=warnings,
    )


def _by_events(
    events: list[Event], priors: Priors, experiment: str, trial: int, motion_s: tuple[float, float]
) -> Alignment:
    """Return the clocks from sync events alone: the hand does not move."""
    found, covariance, middle_s = clock_of_events(events, priors.known_drift, priors.drift)
    offset_s = float(found[0] - (1.0 + found[1]) * middle_s)
    back = np.array([1.0, -middle_s])
    se_s = float(np.sqrt(back @ covariance @ back))
    half_ms = NORMAL * float(np.sqrt(covariance[0, 0])) * 1e3
    return Alignment(
        experiment=experiment,
        trial=trial,
        source="event",
        offset_s=offset_s,
        offset_se_s=se_s,
        drift=float(found[1]),
        drift_se=float(np.sqrt(covariance[1, 1])),
        drift_prior=priors.drift,
        known_drift=priors.known_drift,
        residual_rms_m=None,
        frames=0,
        motion_start_s=motion_s[0],
        motion_end_s=motion_s[1],
        middle_se_s=float(np.sqrt(covariance[0, 0])),
        middle_camera_time_s=middle_s,
        warnings=[
            f"the hand does not move: the offset rests on {len(events)} sync event(s) alone "
            f"(± {half_ms:.2f} ms, 95 %), held against nothing"
        ],
    )
