"""`plan:` the planner."""

from typing import Annotated, Literal

from pydantic import Field, field_validator

from strandcast.core.section import Section

ENSEMBLE_DURATION_S = (0.35, 0.9)  # chosen: the example arms can throw in this time
PAPER_DURATION_S = (0.2, 1.2)  # section V-A of the paper


class PaperReading(Section):
    """Reading of section V where its text is ambiguous, for `planner: paper`."""

    altered_from: Literal["executed", "walking"] = Field(
        "executed",
        description="Later tries alter the motion played last, or walk from the nearest try so far.",
    )
    accept: Literal["first_hit", "best"] = Field(
        "first_hit",
        description="Throw the first motion that hits in the simulation, or the nearest of all tries.",
    )
    ends: Literal["ramp", "rest"] = Field(
        "ramp",
        description="A ramp stops the arm after eq. 1's curve, or the curve itself begins and ends at rest.",
    )
    altered_rad_s: Annotated[float, Field(gt=0, le=10)] = Field(
        0.5,
        description="Largest change of a control point's velocity from one try to the next; the paper's "
        "is 0.5.",
    )
    largest_slope_rad_s2: Annotated[float, Field(gt=0, le=10_000)] = Field(
        60.0,
        description="Largest alpha_k in eq. 1, which the paper does not give.",
    )


class PlanSettings(Section):
    """The planner."""

    planner: Literal["ensemble", "paper"] = Field(
        "ensemble",
        description="Robust planning over the ensemble, or the paper's. Use paper to reproduce the paper.",
    )
    duration_s: tuple[float, float] | None = Field(
        None,
        description="Shortest and longest first motion; by default [0.35, 0.9], for the paper's planner "
        "[0.2, 1.2]. Raise both for a slow arm; lower the shortest for a fast one.",
    )
    control_points: Annotated[int, Field(ge=3, le=20)] = Field(
        6,
        description="Free points of each joint's velocity curve. Raise it for a target that needs a "
        "complicated motion.",
    )
    screening: Annotated[int, Field(ge=8, le=100_000)] = Field(
        1500,
        description="Random motions before the search; with the paper's planner all of its tries. Raise "
        "it if no motion within the limits is found.",
    )
    evaluations: Annotated[int, Field(ge=8, le=1_000_000)] = Field(
        3000,
        description="Most motions in a search; for later motions two thirds. Raise it if the predicted "
        "miss is large although the target is within reach.",
    )
    ensemble: Annotated[int, Field(ge=1, le=64)] = Field(
        16,
        description="Strings in the search for new motions, each with other disturbances. Lower it to "
        "plan faster and less robustly.",
    )
    use_servo: bool | None = Field(
        None,
        description="Plan with the servo's response; by default true, but false with the paper's planner."
        " Set it to false only to compare.",
    )
    paper: PaperReading = Field(
        PaperReading(),
        description="Readings of section V, for `planner: paper`. Change them only to compare.",
    )
    disturbances: Annotated[float, Field(ge=0, le=10)] = Field(
        1.0,
        description="Scale of throw-to-throw disturbances; 1 is a typical rig. Raise it if repeated "
        "throws scatter more than predicted; lower it if less.",
    )
    mesh_refinement: bool = Field(
        True,
        description="Simulate every other string with twice as many points when searching new motions. "
        "Set it to false to plan faster.",
    )
    bias_correction: bool = Field(
        True,
        description="Correct predictions by the simulation's error in past trials. Set it to false only "
        "to compare.",
    )

    @property
    def duration_range_s(self) -> tuple[float, float]:
        """Shortest and longest time of a first motion [s]."""
        return self.duration_s or (PAPER_DURATION_S if self.planner == "paper" else ENSEMBLE_DURATION_S)

    @property
    def plans_with_servo(self) -> bool:
        """Whether to plan with the servo's response, not with the commanded angles."""
        return self.planner != "paper" if self.use_servo is None else self.use_servo

    @field_validator("duration_s")
    @classmethod
    def _shortest_first(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and not 0.05 <= value[0] <= value[1] <= 5.0:
            raise ValueError("must be [shortest, longest] within 0.05 and 5 s")
        return value
