"""Events that both clocks saw, such as an LED that the controller switches: an offset of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.alignment.fit import ClockFit
from strandcast.alignment.problem import Event
from strandcast.errors import StrandcastError
from strandcast.records.joint_log import SYNC_HIGH, JointLog, SyncEvent

CONTRADICTION = 4.0  # standard deviations
LEAST_SIGMA_S = 1e-5
FLAG = "sync output"  # kind of the events that the log's flags tell


@dataclass(frozen=True)
class SeenEvent:
    """An event in the video: its kind, camera time, and the standard deviation of that [s]."""

    kind: str
    camera_s: float
    sigma_s: float


def robot_events(log: JointLog, told: list[SyncEvent]) -> list[SyncEvent]:
    """Return the events on the robot's clock: those that run.json tells, and the log's rising sync output."""
    return [*told, *flag_events(log, True, FLAG)]


def flag_events(log: JointLog, rise: bool, kind: str) -> list[SyncEvent]:
    """Return the rises, or the falls, of the log's sync output as events of a kind."""
    high = ((np.asarray(log.flags) & SYNC_HIGH) > 0) == rise
    rows = np.flatnonzero(high[1:] & ~high[:-1]) + 1
    # The output changed after the row before.
    return [
        SyncEvent(
            kind=kind,
            time_s=float(0.5 * (log.time_s[k - 1] + log.time_s[k])),
            sigma_s=float((log.time_s[k] - log.time_s[k - 1]) / np.sqrt(12.0)),
        )
        for k in rows
    ]


def pair(
    seen: list[SeenEvent], robot: list[SyncEvent], fit: ClockFit | None, file: str | None = None
) -> list[Event]:
    """Return each event of the video with the robot's event of its kind that is nearest by the fit.

    Raises
    ------
    StrandcastError
        SC-A019 the robot tells of no such event, or of several and there is no fit to choose by.
    """
    pairs = []
    for event in seen:
        alike = [other for other in robot if event.kind in (other.kind, "any")]
        if not alike or (fit is None and len(alike) > len(seen)):
            there = ", ".join(f"{other.kind} at {other.time_s:.4f} s" for other in robot) or "none"
            raise StrandcastError(
                "SC-A019",
                f"the video's event {event.kind!r} at {event.camera_s:.4f} s has "
                f"{'no' if not alike else 'several'} counterparts in the joint log (there: {there})",
                file=file,
                field="align.sync_events",
                fix="give it the kind that run.json tells, or the kind 'any'; leave out what the log has not",
            )
        if fit is None:
            ranks = sorted(other.camera_s for other in seen if other.kind == event.kind)
            ranked = sorted(alike, key=lambda other: other.time_s)
            nearest = ranked[min(ranks.index(event.camera_s), len(alike) - 1)]
        else:
            told_s = fit.told_s(event.camera_s)
            nearest = min(alike, key=lambda other: abs(other.time_s - told_s))
        sigma_s = float(np.hypot(event.sigma_s, nearest.sigma_s))
        pairs.append(Event(event.camera_s, nearest.time_s, max(sigma_s, LEAST_SIGMA_S)))
    return pairs


def refuse_contradiction(events: list[Event], fit: ClockFit, file: str | None = None) -> None:
    """Refuse an event that the hand's motion denies.

    Raises
    ------
    StrandcastError
        SC-A018 with both offsets and their standard deviations.
    """
    for event in events:
        told_s, se_s = fit.told_s(event.camera_s), fit.told_se_s(event.camera_s)
        apart_s = event.robot_s - told_s
        if abs(apart_s) > CONTRADICTION * float(np.hypot(event.sigma_s, se_s)):
            by_event_s = event.robot_s - event.camera_s * (1.0 + fit.drift)
            raise StrandcastError(
                "SC-A018",
                f"the sync event at {event.camera_s:.4f} s puts the offset at {by_event_s * 1e3:.2f} ms "
                f"(± {event.sigma_s * 1e3:.2f}), the hand's motion at {(by_event_s - apart_s) * 1e3:.2f} ms "
                f"(± {se_s * 1e3:.2f}): {apart_s * 1e3:+.2f} ms apart",
                file=file,
                field="align.sync_events",
                cost=f"one of the clocks is wrong by {abs(apart_s) * 1e3:.1f} ms",
                fix="check the event's frame and kind, its delay from output to light, and that log and "
                "video are of one throw; leave the event out to trust the motion",
            )


def clock_of_events(
    events: list[Event], drift: float, drift_sd: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return (robot time of the middle, drift), their covariance, and the middle, from events alone."""
    camera_s = np.array([event.camera_s for event in events])
    sigma_s = np.array([event.sigma_s for event in events])
    weight = sigma_s**-2.0
    middle_s = float((weight * camera_s).sum() / weight.sum())
    slope = np.stack([np.ones(len(events)), camera_s - middle_s], axis=1)
    told_s = np.array([event.robot_s for event in events]) - camera_s
    information = slope.T @ (weight[:, None] * slope) + np.diag([0.0, drift_sd**-2.0])
    covariance = np.linalg.inv(information)
    found = covariance @ (slope.T @ (weight * told_s) + np.array([0.0, drift / drift_sd**2]))
    return found + np.array([middle_s, 0.0]), covariance, middle_s
