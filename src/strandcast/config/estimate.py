"""`estimate:` the fit of the string."""

from collections.abc import Collection, Iterable
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from strandcast.core.section import Section
from strandcast.core.strings import PARAMETERS, SPATIAL_RANGES, ForceName

PluginName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]{0,40}$")]
# Chosen: a third found fewer of the true strings, twice as many hardly more (docs/explanation/claims.md).
THOROUGH_EVALUATIONS = 180_000
# Chosen: with the default weights, the trials before these have under 2 % of the weight of all.
RECENT_TRIALS = 8
Ranges = Literal["wide", "paper"] | dict[str, tuple[float, float]]
# Of fits in space, where the file gives nothing else; chosen. Captures converge earlier than after so many
# simulations, and between two throws of an arm there is less time.
IN_SPACE: dict[str, Any] = {
    "search": "screened",
    "evaluations": 6000,
    "older_trials_weight": 1.0,
    "dt_s": 2e-3,
    "clamp_offset_sd_rad": "any",
    "horizon_s": None,
}
THROWN_IN_SPACE = IN_SPACE | {"evaluations": 500, "profiles": False}


def known_names(
    names: Iterable[str], known: Collection[str] = PARAMETERS, what: str = "string parameter"
) -> None:
    """Refuse names that are not known."""
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ValueError(f"{unknown[0]!r} is no {what}; these are: {', '.join(known)}")


class EstimateSettings(Section):
    """The fit of the string."""

    search: PluginName = Field(
        "descent",
        description="descent: Gauss-Newton from several draws; thorough: finds the best string more "
        "surely, in thirty times the time; screened (by default in space, and of captures): descents from "
        "the best of 64 draws, 128 in the plane; or an installed one. Use thorough if you read the "
        "parameters.",
    )
    evaluations: Annotated[int, Field(ge=100, le=1_000_000)] = Field(
        4000,
        description="Most strings to simulate in the search (180000 if search is thorough; in space 6000, "
        "of throws 500). Raise it if twice as many lower E noticeably.",
    )
    trials: Annotated[int, Field(ge=1)] | Literal["all", "latest"] = Field(
        RECENT_TRIALS,
        description="How many of the newest trials a fit takes; or all (ever slower), or latest. Use "
        "latest if the string changed between throws.",
    )
    older_trials_weight: Annotated[float, Field(ge=0, le=1)] = Field(
        0.6,
        description="Weight of a trial relative to the next one (in space 1). Raise it to 1 if the string "
        "surely stays the same; lower it if it wears or slips.",
    )
    ranges: Ranges = Field(
        "wide",
        description="Ranges of the parameters: wide (for stiff strings too), paper, or [least, "
        "greatest] by parameter, in space by those that the report lists. Give a wider one if the report "
        "warns of a bound.",
    )
    dt_s: Annotated[float, Field(gt=0, le=0.005)] = Field(
        1e-3,
        description="Time step (in space 0.002). Lower it to check that results do not depend on it, or if "
        "strings of many points diverge.",
    )
    start_shape: Literal["observed", "hanging"] = Field(
        "observed",
        description="Shape at the start: as observed, or hanging at rest (of captures in space: what begins "
        "with the recording). Use hanging if the first frames do not show the string well.",
    )
    forces: Literal["auto", "paper"] | list[ForceName] = Field(
        "auto",
        description="Optional parts of the model: auto tries them and keeps those that predict better what "
        "was not fitted; paper has none; or a list of those to fit. Give it to fit the same ones everywhere.",
    )
    clamp_offset_sd_rad: Annotated[float, Field(ge=0, le=0.5)] | Literal["any"] | None = Field(
        None,
        description="Fit a turn of the clamp against the arm's file, with this standard deviation before the "
        "fit; any: all turns are as likely (by default in space, of each clamp); 0, by default in the plane: "
        "no turn. Set it, to 0.05 or more for a clamp set by eye, if the string's angle in the hand varies.",
    )
    camera_offset_sd_m: Annotated[float, Field(gt=0, le=0.05)] | None = Field(
        None,
        description="Of films: fit an offset of the camera from the robot, with this standard deviation "
        "before the fit. Set it if the tracked hand stays at a distance from the arm's kinematics.",
    )
    horizon_s: Annotated[float, Field(ge=0, le=60)] | None = Field(
        0.03,
        description="Of throws at a target: frames up to this long after the closest approach enter E; null "
        "(in space): all. Raise it to fit the swing after the hit.",
    )
    contact_radius_m: Annotated[float, Field(gt=0, le=0.5)] | None = Field(
        0.02,
        description="A throw that misses by no more may touch the target: later frames do not enter E. "
        "Set it to the radius of what stands there, or to null.",
    )
    profiles: bool = Field(
        True,
        description="Find how far each parameter may move while E rises by 10 % (of throws in space only if "
        "asked for). Set it to false to save time.",
    )

    def in_space(self, *, thrown: bool) -> Self:
        """Return the settings of a fit in space, by its own defaults."""
        defaults, given = THROWN_IN_SPACE if thrown else IN_SPACE, set(self.model_fields_set)
        given -= {"clamp_offset_sd_rad"} if self.clamp_offset_sd_rad is None else set()
        if "search" in given and self.search != defaults["search"]:
            given.add("evaluations")  # that search has its own
        return self.model_copy(update={name: defaults[name] for name in defaults if name not in given})

    def of_captures(self) -> Self:
        """Return the settings of a fit of captures in the plane, by their own default."""
        return self.model_copy(update={} if "search" in self.model_fields_set else {"search": "screened"})

    @property
    def evaluation(self) -> Literal["world", "hand"]:
        """Frame of E: the world, or the hand, as in the paper, which centres images on the grasping point."""
        return "hand" if self.search == "paper" else "world"

    @property
    def free_end(self) -> bool:
        """Whether the last point, which carries half a segment, has half a mass; not in the paper."""
        return self.search != "paper"

    @property
    def trials_read(self) -> int | None:
        """How many trials a fit reads, the newest; None: all.

        The response of the servos is fitted to more than the latest, which is still the same arm.
        """
        if self.trials == "all":
            return None
        return RECENT_TRIALS if self.trials == "latest" else self.trials

    @model_validator(mode="after")
    def _a_thorough_search_has_its_own_budget(self) -> Self:
        if self.search == "thorough" and "evaluations" not in self.model_fields_set:
            object.__setattr__(self, "evaluations", THOROUGH_EVALUATIONS)
        return self

    @field_validator("ranges")
    @classmethod
    def _ranges_have_names_and_order(cls, value: Ranges) -> Ranges:
        if isinstance(value, dict):
            known_names(value, (*PARAMETERS, *SPATIAL_RANGES))
            bad = [name for name, (low, high) in value.items() if not 0 < low < high]
            if bad:
                raise ValueError(f"the range of {bad[0]} must be [least, greatest], both above 0")
        return value
