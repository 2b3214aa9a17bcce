"""The LED that the robot switches: which of its switchings in the video is which in the log.

They are compared with each other first (both clocks must show the same time between them), then with the
hand's motion.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from strandcast.alignment.events import (
    CONTRADICTION,
    LEAST_SIGMA_S,
    FastestPoint,
    VideoEvent,
    sync_output_events,
)
from strandcast.alignment.fine_fit import ClockFit
from strandcast.alignment.problem import EventPair
from strandcast.config.align import LedSettings
from strandcast.records.joint_log import JointLog, SyncEvent

LED_ON, LED_OFF = "led_on", "led_off"
PLAIN_S = 1e-3  # smallest contradiction that is worth a warning; chosen
FASTEST_DRIFT = 1e-3  # of the clocks, between two switchings; chosen, far beyond any quartz

Match = tuple[int, int]  # index of a switching in the video, and in the log


@dataclass(frozen=True)
class LedPairs:
    """Switchings on both clocks with their kinds, and warnings.

    `contradicted` means that the hand's motion contradicts them.
    """

    events: list[EventPair] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)
    contradicted: bool = False
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Switchings:
    """The LED's switchings in the video, and those of the log with the LED's delay added."""

    video: Sequence[VideoEvent]
    robot: list[SyncEvent]
    latency_sd_s: float
    fit: ClockFit | None

    def sigmas(self, match: Match) -> tuple[float, ...]:
        """Return the standard deviations that make up that of a pair's difference."""
        return self.video[match[0]].sigma_s, self.robot[match[1]].sigma_s, self.latency_sd_s, LEAST_SIGMA_S

    def difference_s(self, match: Match, fit: ClockFit) -> float:
        """Return the robot's time of a pair minus that by the hand's motion."""
        return self.robot[match[1]].time_s - fit.robot_s(self.video[match[0]].camera_time_s)


def led_events(log: JointLog, recorded: Sequence[SyncEvent]) -> list[SyncEvent]:
    """Return when the robot switched the LED: from run.json, or else from the log's sync output."""
    named = [event for event in recorded if event.kind in (LED_ON, LED_OFF)]
    return named or [*sync_output_events(log, True, LED_ON), *sync_output_events(log, False, LED_OFF)]


def pair_led(
    video: Sequence[VideoEvent],
    robot: list[SyncEvent],
    settings: LedSettings,
    fit: ClockFit | None,
    fastest: FastestPoint | None = None,
) -> LedPairs:
    """Pair the LED's switchings in the video with those of the log.

    Each possible pair implies an offset; the offset under which most switchings find a counterpart is used.
    Flashes of something else have none. If every offset matches a single switching and several are possible,
    the motion must agree.

    Parameters
    ----------
    video, robot
        The LED's switchings by tracking, and by `led_events`.
    fit
        The clocks by the hand's motion; None if the motion does not determine them.
    fastest
        For the cost of a contradiction; needed with a fit.
    """
    if not video:
        return LedPairs()
    latency_s, latency_sd_s = settings.latency_and_sd_s
    late = [SyncEvent(kind=e.kind, time_s=e.time_s + latency_s, sigma_s=e.sigma_s) for e in robot]
    led = _Switchings(video, late, latency_sd_s, fit)
    matches = _matches(led)
    if not matches:
        return LedPairs(warnings=[_no_counterpart(video, robot)])
    spare = _list((e.kind, e.camera_time_s) for k, e in enumerate(video) if k not in dict(matches))
    warnings = []
    if spare:
        warnings.append(
            f"SC-A023: the LED's window changes without the robot's switching it ({spare}): ignored"
        )
    events, kinds = _pairs(led, matches), [late[j].kind for _, j in matches]
    if fit is None or fastest is None:
        warnings.append(f"the offset rests on {len(matches)} switching(s) of the LED alone, without a check")
        return LedPairs(events, kinds, False, warnings)
    apart_s, sigma_s = _worst(led, matches, fit)
    contradicted = abs(apart_s) > CONTRADICTION * sigma_s
    if contradicted and abs(apart_s) > PLAIN_S:
        warnings.append(
            f"SC-A023: the LED contradicts the hand's motion: by the LED the robot's clock is "
            f"{apart_s * 1e3:+.2f} ms from where the motion puts it (± {sigma_s * 1e3:.2f}), "
            f"{fastest.error_mm(apart_s):.0f} mm at {fastest}; the motion is used: "
            "check the LED's delay (align.led.latency_s), and that log and video are of one throw"
        )
    return LedPairs(events, kinds, contradicted, warnings)


def _no_counterpart(video: Sequence[VideoEvent], robot: list[SyncEvent]) -> str:
    switched = _list((e.kind, e.camera_time_s) for e in video)
    recorded = _list((e.kind, e.time_s) for e in robot)
    return (
        f"SC-A023: the LED's switchings in the video ({switched}) have no counterpart in run.json's "
        f"sync_events or the log's sync output ({recorded or 'none'}): they are ignored"
    )


def _pairs(led: _Switchings, matches: list[Match]) -> list[EventPair]:
    """Return the pairs for the fit."""
    # They share their uncertainty: one delay, and frames that may keep step with the controller's cycle.
    # Several must not determine the offset better than one.
    return [
        EventPair(
            led.video[k].camera_time_s,
            led.robot[j].time_s,
            float(np.sqrt(len(matches)) * np.linalg.norm(led.sigmas((k, j)))),
        )
        for k, j in matches
    ]


def _worst(led: _Switchings, matches: list[Match], fit: ClockFit) -> tuple[float, float]:
    """Return difference and standard deviation of the pair that contradicts the motion most."""
    apart = []
    for match in matches:
        parts = (*led.sigmas(match), fit.robot_se_s(led.video[match[0]].camera_time_s))
        apart.append((led.difference_s(match, fit), float(np.linalg.norm(parts))))
    return max(apart, key=lambda one: abs(one[0]) / one[1])


def _matches(led: _Switchings) -> list[Match]:
    """Return which switching of the video is which of the robot's; empty if that is ambiguous."""
    alike = [
        (k, j) for k, e in enumerate(led.video) for j, other in enumerate(led.robot) if e.kind == other.kind
    ]
    found = [_agreeing(led, match) for match in alike]
    most = max(map(len, found), default=0)
    best = [list(matches) for matches in {tuple(one) for one in found if len(one) == most}]
    if len(best) > 1 and (fit := led.fit) is not None:
        best.sort(
            key=lambda matches: abs(float(np.mean([led.difference_s(match, fit) for match in matches])))
        )
        best = best[:1]
    if len(best) != 1 or (most == 1 < len(alike) and not _agrees_with_motion(led, best[0])):
        return []
    return best[0]


def _agreeing(led: _Switchings, match: Match) -> list[Match]:
    """Return the pairs with the same time since a given pair on both clocks, each switching once."""
    first, first_robot = led.video[match[0]], led.robot[match[1]]
    near = []
    for b, other in enumerate(led.robot):
        for a, event in enumerate(led.video):
            since_s = event.camera_time_s - first.camera_time_s
            off_s = abs(other.time_s - first_robot.time_s - since_s)
            parts = (event.sigma_s, first.sigma_s, other.sigma_s, first_robot.sigma_s, LEAST_SIGMA_S)
            within_s = CONTRADICTION * float(np.linalg.norm(parts)) + FASTEST_DRIFT * abs(since_s)
            if event.kind == other.kind and off_s <= within_s:
                near.append((off_s, a, b))
    found: dict[int, int] = {}
    for _, a, b in sorted(near):
        if a not in found and b not in found.values():
            found[a] = b
    return sorted(found.items(), key=lambda pair: pair[1])


def _agrees_with_motion(led: _Switchings, matches: list[Match]) -> bool:
    if led.fit is None:
        return False
    apart_s, sigma_s = _worst(led, matches, led.fit)
    return abs(apart_s) <= CONTRADICTION * sigma_s


def _list(events: Iterable[tuple[str, float]]) -> str:
    return ", ".join(f"{kind} at {time_s:.4f} s" for kind, time_s in events)
