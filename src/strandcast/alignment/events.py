"""Events on both clocks, such as an LED that the controller switches: an offset independent of the motion."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from strandcast.alignment.fine_fit import ClockFit
from strandcast.alignment.problem import EventPair
from strandcast.config.align import VideoSyncEvent
from strandcast.errors import StrandcastError
from strandcast.records.joint_log import SYNC_HIGH, JointLog, SyncEvent
from strandcast.records.track import DetectedSwitch

CONTRADICTION = 4.0  # standard deviations; chosen
LEAST_SIGMA_S = 1e-5
SYNC_OUTPUT = "sync output"  # kind of the events in the log's flags

VideoEvent = VideoSyncEvent | DetectedSwitch  # by the settings, or by tracking


class FastestPoint(NamedTuple):
    """The fastest point of the throw: the owner of the speed, as "the hand's", and its speed [m/s]."""

    owner: str
    speed_m_s: float

    def error_mm(self, time_s: float) -> float:
        """Return how far the point moves in a time: the cost of a wrong offset [mm]."""
        return abs(time_s) * self.speed_m_s * 1e3

    def __str__(self) -> str:
        return f"{self.owner} {self.speed_m_s:.1f} m/s"


def robot_events(log: JointLog, recorded: Sequence[SyncEvent]) -> list[SyncEvent]:
    """Return the events on the robot's clock: those in run.json, and the rises of the log's sync output."""
    return [*recorded, *sync_output_events(log, True, SYNC_OUTPUT)]


def sync_output_events(log: JointLog, rise: bool, kind: str) -> list[SyncEvent]:
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


def pair_events(
    video: Sequence[VideoEvent], robot: list[SyncEvent], fit: ClockFit | None, file: str | None = None
) -> list[EventPair]:
    """Pair each event of the video with the robot's event of its kind that is nearest by the fit.

    SC-A018: the log has no such event, or several and there is no fit to choose by.
    """
    pairs = []
    for event in video:
        alike = [other for other in robot if event.kind in (other.kind, "any")]
        rivals = [other for other in video if event.kind in (other.kind, "any")]
        if not alike or (fit is None and len(alike) > len(rivals)):
            raise _no_counterpart(event, robot, "several" if alike else "no", file)
        if fit is None:
            ranks = sorted(other.camera_time_s for other in video if other.kind == event.kind)
            ranked = sorted(alike, key=lambda other: other.time_s)
            nearest = ranked[min(ranks.index(event.camera_time_s), len(alike) - 1)]
        else:
            expected_s = fit.robot_s(event.camera_time_s)
            nearest = min(alike, key=lambda other: abs(other.time_s - expected_s))
        sigma_s = float(np.hypot(event.sigma_s, nearest.sigma_s))
        pairs.append(EventPair(event.camera_time_s, nearest.time_s, max(sigma_s, LEAST_SIGMA_S)))
    return pairs


def _no_counterpart(
    event: VideoEvent, robot: list[SyncEvent], how_many: str, file: str | None
) -> StrandcastError:
    available = ", ".join(f"{other.kind} at {other.time_s:.4f} s" for other in robot) or "none"
    return StrandcastError(
        "SC-A018",
        f"the video's event {event.kind!r} at {event.camera_time_s:.4f} s has {how_many} counterparts in the "
        f"joint log (available: {available})",
        file=file,
        field="align.sync_events",
        fix="give it its kind in run.json, or the kind 'any'; remove events that the log does not have",
    )


def refuse_contradiction(pairs: list[EventPair], fit: ClockFit, file: str | None = None) -> None:
    """Refuse an event that contradicts the hand's motion (SC-A018, with both offsets)."""
    for event in pairs:
        expected_s, se_s = fit.robot_s(event.camera_s), fit.robot_se_s(event.camera_s)
        apart_s = event.robot_s - expected_s
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
                "video are of one throw; remove the event to use the motion alone",
            )


def clock_of_events(
    pairs: list[EventPair], drift: float, drift_sd: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return (robot time of the middle, drift), their covariance, and the middle, from events alone."""
    camera_s = np.array([event.camera_s for event in pairs])
    sigma_s = np.array([event.sigma_s for event in pairs])
    weight = sigma_s**-2.0
    middle_s = float((weight * camera_s).sum() / weight.sum())
    slope = np.stack([np.ones(len(pairs)), camera_s - middle_s], axis=1)
    offset_s = np.array([event.robot_s for event in pairs]) - camera_s
    information = slope.T @ (weight[:, None] * slope) + np.diag([0.0, drift_sd**-2.0])
    covariance = np.linalg.inv(information)
    found = covariance @ (slope.T @ (weight * offset_s) + np.array([0.0, drift / drift_sd**2]))
    return found + np.array([middle_s, 0.0]), covariance, middle_s
