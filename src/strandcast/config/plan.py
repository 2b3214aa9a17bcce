"""`plan:` the planner."""

from typing import Annotated

from pydantic import Field, field_validator

from strandcast.core.section import Section


class PlanSettings(Section):
    """The planner."""

    duration_s: tuple[float, float] = Field(
        (0.35, 0.9),  # chosen: the example arms can throw in this time
        description="Shortest and longest first motion. Raise both for a slow arm; lower the shortest for a "
        "fast one.",
    )
    evaluations: Annotated[int, Field(ge=8, le=1_000_000)] = Field(
        1500,
        description="Random motions before a search, and most motions in it; for later motions two thirds. "
        "With method: paper all of its tries (2400). Raise it if no motion within the limits is found, or if "
        "the predicted miss is large although the target is within reach.",
    )
    disturbances: Annotated[float, Field(ge=0, le=10)] = Field(
        1.0,
        description="Scale of throw-to-throw disturbances; 1 is a typical rig. Raise it if repeated "
        "throws scatter more than predicted; lower it if less.",
    )

    @field_validator("duration_s")
    @classmethod
    def _shortest_first(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not 0.05 <= value[0] <= value[1] <= 5.0:
            raise ValueError("must be [shortest, longest] within 0.05 and 5 s")
        return value
