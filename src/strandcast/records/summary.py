"""verdict.json and summary.json: did the tip hit, and how did the trials go."""

from __future__ import annotations

from typing import ClassVar

from strandcast.records.record import Part, Record

AFTER_MOTION_S = 0.3  # a miss is looked for until then: the tip may arrive after the arm has stopped


class Verdict(Record):
    """The miss of one trial, from the track; null, with the reason, if not seen."""

    SCHEMA: ClassVar[str] = "strandcast/verdict"

    experiment: str
    trial: int
    target_m: list[float]
    hit_radius_m: float
    miss_m: float | None
    miss_sigma_m: float | None
    hit: bool
    closest_frame: int | None
    closest_robot_time_s: float | None
    closest_m: list[float] | None
    reason: str | None
    objective: str = "point"  # its kind: what the miss is from
    wanted: str | None = None  # what the miss is from, in words, where it is more than a point or a bar
    bar_m: list[list[float]] | None = None  # both ends, of a bar to strike


class TrialSummary(Part):
    """One line of the experiment's table."""

    trial: int
    miss_m: float | None
    miss_sigma_m: float | None
    hit: bool
    E_planned_m: float | None
    E_m: float | None
    tracked_fraction: float | None
    alignment_offset_s: float | None
    alignment_offset_se_s: float | None
    excluded: str | None = None  # the reason


class Summary(Record):
    """One experiment in numbers."""

    SCHEMA: ClassVar[str] = "strandcast/summary"

    experiment: str
    string_length_m: float
    target_m: list[float]
    hit_radius_m: float
    hit_trial: int | None
    trials: list[TrialSummary]
    next_motion_sha256: str | None
