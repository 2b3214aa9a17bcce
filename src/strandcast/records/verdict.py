"""verdict.json: by how much the tip of one throw missed."""

from typing import ClassVar

from strandcast.records.record import Record

AFTER_MOTION_S = 0.3  # the miss counts until then: the tip may arrive after the arm has stopped; chosen


class Verdict(Record):
    """The miss of one trial, from the track; null, with the reason, if the tip was not detected.

    A trial without a target has no miss, and is no hit or miss: these are null, too.
    """

    SCHEMA: ClassVar[str] = "strandcast/verdict"

    experiment: str
    trial: int
    target_m: list[float] | None  # null: the experiment has no target
    hit_radius_m: float
    miss_m: float | None
    # Of the tip, in its frames and common to all of them, and of the string's plane where a camera filmed it.
    miss_sigma_m: float | None
    hit: bool | None
    closest_frame: int | None
    closest_robot_time_s: float | None
    closest_m: list[float] | None
    reason: str | None
    objective: str = "point"  # its kind
    wanted: str | None = None  # the aim in words, if it is not a point or a bar
    bar_m: list[list[float]] | None = None  # both ends of a bar to strike

    def target(self) -> list[float]:
        """Return the target; only for what is not done for a trial without one."""
        assert self.target_m is not None
        return self.target_m
