"""The objectives of a throw: every kind, declared once.

A kind is a section of experiment.yaml. Its behaviour in planner and scorer is registered for its class:
`planning.simulated_misses.simulated_miss` and `scoring.measured_misses.measured_shortfall`.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, TypeVar, Union, get_args

from pydantic import Field, GetCoreSchemaHandler, model_validator
from pydantic_core import CoreSchema

from strandcast.core.quantities import Place, Position, value_and_sd
from strandcast.core.registry import Registry
from strandcast.core.section import Section

# Weights of an objective's terms besides distance, in metres; chosen so high that a hit of 20 mm is within
# 1.2 degrees beyond the tolerance, and 0.2 m/s of the speed.
DIRECTION_M_RAD = 1.0
SPEED_S = 0.1
# A velocity is a chord over this time to each side, because track and bias correction are noisy; chosen.
VELOCITY_S = 0.006

XY = tuple[Position, Position]
XYZ = tuple[Position, Position, Position]


class Objective(Section):
    """The objective of a throw. Every kind derives from this class; `register_objective` registers it."""

    kind: str
    target_field: ClassVar[str] = "objective"  # the setting with the place to reach

    @property
    def description(self) -> str:
        """The objective in words."""
        return self.kind

    @property
    def refinement(self) -> str | None:
        """The description unless the target, or a bar's ends, are the whole objective; else None."""
        return self.description

    @property
    def bar_m(self) -> tuple[XY, XY] | None:
        """Both ends of the bar to strike, None if there is none [m]."""
        return None

    @property
    def marks_m(self) -> list[XY] | None:
        """Places to mark in figures [m]; None: the experiment's target."""
        return []

    @property
    def along_m(self) -> list[float]:
        """Places on the string that the objective names, from the hand [m]."""
        return []

    @classmethod
    def default_target_m(cls, settings: dict[str, Any]) -> Any:
        """Return target_m of an experiment that has none, from the objective's settings as written.

        None where the experiment must have one. Wrong settings may raise a TypeError, KeyError, IndexError or
        ValueError.
        """
        return None

    def aimed_at(self, target_m: tuple[float, ...]) -> Objective:
        """Return the objective together with the experiment's target, if it needs that."""
        return self


Direction = Annotated[float, Field(ge=-7, le=7)]
TOLERANCE_RAD = 0.35  # chosen


class PointObjective(Objective):
    """The tip hits the target; on request moving in a direction, and not too slowly."""

    kind: Literal["point"] = Field(
        "point", description="The tip hits target_m. Leave it out unless you set direction or speed."
    )
    direction_rad: Direction | tuple[Direction, Annotated[float, Field(gt=0, le=math.pi)]] | None = Field(
        None,
        description="Direction of the tip at the hit, counter-clockwise from x, by default any; and the "
        f"allowed deviation, by default {TOLERANCE_RAD}, beyond which the miss grows by 1 m/rad. Set it if "
        "the tip must arrive from one side.",
    )
    least_speed_m_s: Annotated[float, Field(ge=0, le=100)] = Field(
        0.0,
        description="Least speed of the tip at the hit; below it the miss grows by 0.1 m per m/s. Raise "
        "it if the tip must strike.",
    )

    target_field: ClassVar[str] = "target_m"

    @property
    def direction_and_tolerance_rad(self) -> tuple[float, float] | None:
        """The direction and how far from it the tip may move [rad]; None: any direction will do."""
        return None if self.direction_rad is None else value_and_sd(self.direction_rad, TOLERANCE_RAD)

    @property
    def has_velocity(self) -> bool:
        """Whether the tip's direction or speed matters."""
        return self.direction_rad is not None or self.least_speed_m_s > 0.0

    @property
    def description(self) -> str:
        """The objective in words."""
        words = "point"
        if self.direction_and_tolerance_rad is not None:
            direction_deg, tolerance_deg = map(math.degrees, self.direction_and_tolerance_rad)
            words += f", the tip moving at {direction_deg:.0f}° ± {tolerance_deg:.0f}°"
        if self.least_speed_m_s > 0.0:
            words += f", at {self.least_speed_m_s:g} m/s at least"
        return words

    @property
    def refinement(self) -> str | None:
        """The description if the tip's velocity matters."""
        return self.description if self.has_velocity else None

    @property
    def marks_m(self) -> list[XY] | None:
        """None: the experiment's target."""
        return None

    def aimed_at(self, target_m: tuple[float, ...]) -> Objective:
        """Return the objective with its target, in the plane or in space."""
        place = tuple(map(float, target_m))
        if len(place) == 3:
            return PointInSpace(target_m=place)
        return AimedPoint(**self.model_dump() | {"target_m": place})


class AimedPoint(PointObjective):
    """A point objective with the experiment's target, for planner and scorer."""

    target_m: XY


class PointInSpace(Objective):
    """The tip hits a target in space, for planner and scorer."""

    kind: Literal["point"] = "point"
    target_m: XYZ

    target_field: ClassVar[str] = "target_m"

    @property
    def refinement(self) -> None:
        """None: the target is the whole objective."""


class SegmentObjective(Objective):
    """The tip hits a bar anywhere between two ends; target_m is its middle if not given."""

    kind: Literal["segment"] = Field(description="Selects this objective.")
    ends_m: tuple[XY, XY] = Field(description="Both ends of the bar in the world frame.")

    @property
    def description(self) -> str:
        """The objective in words."""
        return "bar from ({:g}, {:g}) to ({:g}, {:g}) m".format(*self.ends_m[0], *self.ends_m[1])

    @property
    def refinement(self) -> str | None:
        """None: the bar's ends are the whole objective."""
        return None

    @property
    def bar_m(self) -> tuple[XY, XY] | None:
        """Both ends of the bar."""
        return self.ends_m

    @property
    def marks_m(self) -> list[XY] | None:
        """Both ends of the bar."""
        return list(self.ends_m)

    @classmethod
    def default_target_m(cls, settings: dict[str, Any]) -> Any:
        """Return the middle of the bar."""
        (ax, ay), (bx, by) = settings["ends_m"]
        return [0.5 * (ax + bx), 0.5 * (ay + by)]


class ShapePlace(Section):
    """A place on the string, from the hand, and its target."""

    along_m: Place = Field(description="Place on the string, from the hand.")
    at_m: XY = Field(description="Where that point should be, in the world frame.")


class ShapeObjective(Objective):
    """The string takes a shape for a moment; target_m is the target of its last place if not given."""

    kind: Literal["shape"] = Field(description="Selects this objective.")
    places: Annotated[list[ShapePlace], Field(min_length=1, max_length=50)] = Field(
        description="Points of the string and where they should be."
    )

    @property
    def description(self) -> str:
        """The objective in words."""
        return f"shape through {len(self.places)} places"

    @property
    def marks_m(self) -> list[XY] | None:
        """The targets of the places."""
        return [place.at_m for place in self.places]

    @property
    def along_m(self) -> list[float]:
        """Places on the string, from the hand [m]."""
        return [place.along_m for place in self.places]

    @classmethod
    def default_target_m(cls, settings: dict[str, Any]) -> Any:
        """Return the target of the last place."""
        return settings["places"][-1]["at_m"]


class SwingObjective(Objective):
    """The tip reaches a height or a speed; if unattainable, it gets as close as possible."""

    kind: Literal["swing"] = Field(description="Selects this objective.")
    height_m: Position | None = Field(
        None, description="Height (y) that the tip must reach. Give it or speed_m_s."
    )
    speed_m_s: Annotated[float, Field(gt=0, le=1000)] | None = Field(
        None, description="Speed that the tip must reach. Give it or height_m."
    )

    @property
    def description(self) -> str:
        """The objective in words."""
        least = f"{self.height_m:g} m high" if self.speed_m_s is None else f"at {self.speed_m_s:g} m/s"
        return f"swing, the tip {least} at least"

    @model_validator(mode="after")
    def _one_of_both(self) -> SwingObjective:
        if (self.height_m is None) == (self.speed_m_s is None):
            raise ValueError("give height_m or speed_m_s")
        return self


Kind = TypeVar("Kind", bound=Objective)

OBJECTIVES: Registry[type[Objective]] = Registry("objective", "strandcast.objectives", field="objective.kind")


def register_objective(kind: type[Kind]) -> type[Kind]:
    """Make a kind of objective known to experiment.yaml; a class decorator.

    Its field `kind` is a literal: its name there.
    """
    (name,) = get_args(kind.model_fields["kind"].annotation)
    OBJECTIVES.register(name, kind)
    return kind


for _kind in (PointObjective, SegmentObjective, ShapeObjective, SwingObjective):
    register_objective(_kind)


class _AnyRegistered:
    """Validate a field as one of the registered kinds."""

    @staticmethod
    def __get_pydantic_core_schema__(source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        choices: Any = Union[tuple(OBJECTIVES.known().values())]  # noqa: UP007 - of a tuple known only here
        return handler.generate_schema(Annotated[choices, Field(discriminator="kind")])


AnyObjective = Annotated[Objective, _AnyRegistered]
