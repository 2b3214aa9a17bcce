"""The LED that the robot switches: which of its switchings in the video is which in the log.

They are held against each other first (they must lie equally far apart by both clocks), then against the
hand's motion.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from strandcast.alignment.events import CONTRADICTION, LEAST_SIGMA_S, SeenEvent, flag_events
from strandcast.alignment.fit import ClockFit
from strandcast.alignment.problem import Event
from strandcast.records.joint_log import JointLog, SyncEvent

LED_ON, LED_OFF = "led_on", "led_off"
PLAIN_S = 1e-3  # from which on a contradiction is told
FASTEST_DRIFT = 1e-3  # of the clocks, between two switchings


@dataclass(frozen=True)
class Led:
    """Switchings of an LED in the video, and its delay behind the joint log: one for all of them [s]."""

    seen: list[SeenEvent]
    latency_s: float = 0.0
    latency_sd_s: float = 0.0


@dataclass(frozen=True)
class LedPairs:
    """Switchings that both clocks tell, their kinds, and what is to be told of the others.

    `denied` says that the hand's motion contradicts them.
    """

    events: list[Event] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)
    denied: bool = False
    warnings: list[str] = field(default_factory=list)


def led_events(log: JointLog, told: list[SyncEvent]) -> list[SyncEvent]:
    """Return when the robot switched the LED: as run.json tells, else by the log's sync output."""
    named = [event for event in told if event.kind in (LED_ON, LED_OFF)]
    return named or [*flag_events(log, True, LED_ON), *flag_events(log, False, LED_OFF)]


def pair_led(
    led: Led, robot: list[SyncEvent], fit: ClockFit | None, speed_m_s: float, whose: str
) -> LedPairs:
    """Return the LED's switchings with those of the log.

    A pair of them fixes the offset; the offset is taken by which most switchings find a counterpart. A flash
    of something else has none. Where all offsets find but one, and there are several, the motion must agree.

    Parameters
    ----------
    led
        As seen in the video.
    robot
        When the robot switched it, of `led_events`.
    fit
        The clocks by the hand's motion; None where that does not tell them.
    speed_m_s, whose
        How fast the fastest thing moves, and what that is, for what a contradiction costs.
    """
    if not led.seen:
        return LedPairs()
    lit = [SyncEvent(kind=e.kind, time_s=e.time_s + led.latency_s, sigma_s=e.sigma_s) for e in robot]
    matches = _matches(led, lit, fit)
    if not matches:
        seen, there = _list((e.kind, e.camera_s) for e in led.seen), _list((e.kind, e.time_s) for e in robot)
        return LedPairs(
            warnings=[
                f"SC-A024: the LED's switchings in the video ({seen}) have no counterpart in run.json's "
                f"sync_events or the log's sync output ({there or 'none'}): they are left out"
            ]
        )
    pairs = [(led.seen[k], lit[j]) for k, j in matches]
    spare = _list((e.kind, e.camera_s) for k, e in enumerate(led.seen) if k not in dict(matches))
    told = (
        [f"SC-A025: the LED's window changes without the robot's doing ({spare}): left out"] if spare else []
    )
    if fit is None:
        told.append(f"the offset rests on {len(pairs)} switching(s) of the LED alone, held against nothing")
        return LedPairs(*_events(pairs, led), False, told)
    apart_s, sigma_s = _worst(pairs, led, fit)
    denied = abs(apart_s) > CONTRADICTION * sigma_s
    if denied and abs(apart_s) > PLAIN_S:
        told.append(
            f"SC-A023: the LED contradicts the hand's motion: by the LED the robot's clock is "
            f"{apart_s * 1e3:+.2f} ms from where the motion puts it (± {sigma_s * 1e3:.2f}), "
            f"{abs(apart_s) * speed_m_s * 1e3:.0f} mm at {whose} {speed_m_s:.1f} m/s; the motion is "
            "followed: check the LED's delay (align.led.latency_s), and that log and video are of one throw"
        )
    return LedPairs(*_events(pairs, led), denied, told)


def _events(pairs: list[tuple[SeenEvent, SyncEvent]], led: Led) -> tuple[list[Event], list[str]]:
    """Return the pairs as what a fit takes, and their kinds."""
    # What makes them unsure they share: one delay, and frames that may keep step with the controller's cycle.
    # Several are to tell the offset no better than one.
    events = [
        Event(
            seen.camera_s,
            lit.time_s,
            float(np.sqrt(len(pairs)) * np.linalg.norm(_sigmas(seen, lit, led))),
        )
        for seen, lit in pairs
    ]
    return events, [lit.kind for _, lit in pairs]


def _sigmas(seen: SeenEvent, lit: SyncEvent, led: Led) -> tuple[float, ...]:
    return seen.sigma_s, lit.sigma_s, led.latency_sd_s, LEAST_SIGMA_S


def _worst(pairs: list[tuple[SeenEvent, SyncEvent]], led: Led, fit: ClockFit) -> tuple[float, float]:
    """Return difference and standard deviation of the pair that contradicts the motion most."""
    apart = []
    for seen, lit in pairs:
        parts = (*_sigmas(seen, lit, led), fit.told_se_s(seen.camera_s))
        apart.append((lit.time_s - fit.told_s(seen.camera_s), float(np.linalg.norm(parts))))
    return max(apart, key=lambda one: abs(one[0]) / one[1])


def _matches(led: Led, lit: list[SyncEvent], fit: ClockFit | None) -> list[tuple[int, int]]:
    """Return which of the seen switchings (k) is which of the robot's (j); none where it is not clear."""
    alike = [(k, j) for k, e in enumerate(led.seen) for j, other in enumerate(lit) if e.kind == other.kind]
    found = [_agreeing(k, j, led.seen, lit) for k, j in alike]
    most = max(map(len, found), default=0)
    best = [list(matches) for matches in {tuple(one) for one in found if len(one) == most}]
    if len(best) > 1 and fit is not None:
        best.sort(key=lambda matches: _off_s(matches, led, lit, fit))
        best = best[:1]
    if len(best) != 1 or (most == 1 < len(alike) and not _agrees(best[0], led, lit, fit)):
        return []
    return best[0]


def _agreeing(k: int, j: int, seen: list[SeenEvent], lit: list[SyncEvent]) -> list[tuple[int, int]]:
    """Return the pairs that lie as far from pair (k, j) by one clock as by the other."""
    found = []
    for b, other in enumerate(lit):
        offs = []
        for a, event in enumerate(seen):
            since_s = event.camera_s - seen[k].camera_s
            off_s = abs(other.time_s - lit[j].time_s - since_s)
            parts = (event.sigma_s, seen[k].sigma_s, other.sigma_s, lit[j].sigma_s, LEAST_SIGMA_S)
            within_s = CONTRADICTION * float(np.linalg.norm(parts)) + FASTEST_DRIFT * abs(since_s)
            if event.kind == other.kind and off_s <= within_s:
                offs.append((off_s, a))
        if offs:
            found.append((min(offs)[1], b))
    return found


def _off_s(matches: list[tuple[int, int]], led: Led, lit: list[SyncEvent], fit: ClockFit) -> float:
    return abs(float(np.mean([lit[j].time_s - fit.told_s(led.seen[k].camera_s) for k, j in matches])))


def _agrees(matches: list[tuple[int, int]], led: Led, lit: list[SyncEvent], fit: ClockFit | None) -> bool:
    if fit is None:
        return False
    apart_s, sigma_s = _worst([(led.seen[k], lit[j]) for k, j in matches], led, fit)
    return abs(apart_s) <= CONTRADICTION * sigma_s


def _list(events: Iterable[tuple[str, float]]) -> str:
    return ", ".join(f"{kind} at {time_s:.4f} s" for kind, time_s in events)
