"""`estimate:` the fit of the string."""

from collections.abc import Iterable
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from strandcast.core.section import Section
from strandcast.core.strings import PARAMETERS

PluginName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]{0,40}$")]
# Chosen: a third found fewer of the true strings, twice as many hardly more (docs/explanation/claims.md).
THOROUGH_EVALUATIONS = 180_000
# Chosen: with the default weights, the trials before these have under 2 % of the weight of all.
RECENT_TRIALS = 8
Ranges = Literal["wide", "paper"] | dict[str, tuple[float, float]]


def known_parameters(names: Iterable[str]) -> None:
    """Refuse names that are no string parameters."""
    unknown = [name for name in names if name not in PARAMETERS]
    if unknown:
        raise ValueError(f"{unknown[0]!r} is no string parameter; these are: {', '.join(PARAMETERS)}")


class PaperSearch(Section):
    """Numbers of eq. 3 that the paper does not print."""

    centre: Literal["fixed", "running"] = Field(
        "running",
        description="Draw around the previous trial's estimate (fixed), or around the best so far "
        "(running). Change it only to compare readings of the paper: fixed is far worse.",
    )
    chi_0: Annotated[float, Field(gt=0, le=1)] = Field(
        1.0,
        description="Largest first change of a parameter with one trial, as a share of its range. Change "
        "it only to compare readings of the paper.",
    )
    beta: Annotated[float, Field(gt=0, lt=1)] = Field(
        0.999,
        description="Factor by which the largest change shrinks from change to change. Lower it for a "
        "small number of evaluations.",
    )


class EstimateSettings(Section):
    """The fit of the string."""

    search: PluginName = Field(
        "descent",
        description="descent: Gauss-Newton from several draws; thorough: eight searches from other draws, "
        "which find the best string far more surely and take some thirty times as long; paper: the "
        "paper's eq. 3; or an optimiser that an installed package provides. Use thorough if you read the "
        "parameters, and paper to reproduce the paper.",
    )
    evaluations: Annotated[int, Field(ge=100, le=1_000_000)] = Field(
        4000,
        description="Strings to simulate for the search (180000 where search is thorough and this is not "
        "given), which ends earlier where nothing gains any more; "
        "forecast and profiles may add to them. Raise it if twice as many lower E noticeably.",
    )
    trials: Annotated[int, Field(ge=1)] | Literal["all", "latest"] = Field(
        RECENT_TRIALS,
        description="Number of trials that a fit takes, the newest; its search starts from the fit before, "
        "which had older ones; or all, which takes ever longer; or latest. Use latest if the string changed "
        "between throws, or to reproduce the paper.",
    )
    older_trials_weight: Annotated[float, Field(ge=0, le=1)] = Field(
        0.6,
        description="Weight of a trial in the fit relative to the trial after it. Raise it to 1, and "
        "`trials` with it, if the string surely stays the same; lower it if it wears or slips.",
    )
    evaluation: Literal["world", "hand"] = Field(
        "world",
        description="Frame of the evaluation value E: world, or positions relative to the hand. Use hand "
        "if the camera's and the arm's frames do not agree, or to compare with the paper's "
        "figures.",
    )
    w: Annotated[float, Field(ge=0, le=10)] = Field(
        0.1,
        description="Weight of eq. 6: point i counts 1 + w (i - 1), more towards the tip. Raise it if "
        "only the tip matters; 0 weights all points alike.",
    )
    ranges: Ranges = Field(
        "wide",
        description="Ranges of the string parameters: wide (widened for a stiff string), the paper's, or "
        "[least, greatest] by parameter. Give a wider range if the report warns of a bound; "
        "use paper to reproduce the paper.",
    )
    reading: Literal["rate", "sign", "strain"] = Field(
        "rate",
        description="Which bend takes the coefficients h and which sh: growing and straightening (rate), "
        "left and right (sign), or compressed and stretched (strain). Change it only to "
        "compare readings of the paper.",
    )
    dt_s: Annotated[float, Field(gt=0, le=0.005)] = Field(
        1e-3,
        description="Time step of the simulation. Lower it to check that results do not depend on it, or "
        "if strings of many points diverge; the time taken grows in proportion.",
    )
    start_shape: Literal["observed", "hanging"] = Field(
        "observed",
        description="Shape of the string at the start of the simulation: as observed, or hanging at rest. "
        "Use hanging if the first frames do not show the string well and it hung still.",
    )
    free_end: bool = Field(
        True,
        description="Give the last point half the mass of the others: it carries half of one segment, not of "
        "two. Set it to false for the paper's model, in which all plain points are alike and fitted weights "
        "are too heavy. In space the end is always free.",
    )
    rest_curl: bool = Field(
        True,
        description="Fit a constant rest curvature; real cables keep one. Set it to false only for a "
        "chain or for the paper's model.",
    )
    clamp_offset: bool = Field(
        False,
        description="Fit a turn of the clamp against the arm's file. Set it if the string leaves the hand "
        "at an angle that varies from grasp to grasp.",
    )
    clamp_offset_sd_rad: Annotated[float, Field(gt=0, le=0.5)] = Field(
        0.05,
        description="Standard deviation of the clamp's turn before the fit. Raise it for a clamp set by "
        "eye; it counts with clamp_offset only.",
    )
    camera_offset_sd_m: Annotated[float, Field(gt=0, le=0.05)] | None = Field(
        None,
        description="Fit an offset of the camera against the robot, of this standard deviation before the "
        "fit; null: none. Set it if the report shows the tracked hand a constant distance "
        "from the arm's kinematics.",
    )
    stiff_bend: bool = Field(
        False,
        description="Fit how much stiffer the stiff sections bend than the string. Set it for sections "
        "that bend a little, such as heat-shrink tubing.",
    )
    bend_friction: bool = Field(
        False,
        description="Fit one dry friction of all joints. Set it for thick cables, which stop swinging "
        "abruptly.",
    )
    friction_stick: bool = Field(
        False,
        description="Fit dry friction that sticks, and the bend over which it builds up. Set it for cables "
        "that rest where friction holds them, or that are stiffer in small motions than in large ones.",
    )
    marker_shift: bool = Field(
        False,
        description="In space, fit by how much all markers are farther along the string than declared. Set "
        "it for few markers where the place of the last one, or the free length, is not known well.",
    )
    drag_along: bool | Literal["auto"] = Field(
        "auto",
        description="Let air drag be smaller along the string than across it, and fit the ratio: always, "
        "never (drag is the same in all directions, as in the paper's Table 1), or where it explains the "
        "throws better (auto), as with light, thick strings. Use false to reproduce the paper.",
    )
    find_weights: Annotated[int, Field(ge=0, le=3)] = Field(
        0,
        description="Number of weights at unknown places: place and mass are both estimated. Set it if "
        "you cannot measure where the weights sit; expect more throws.",
    )
    horizon_s: Annotated[float, Field(ge=0, le=60)] | None = Field(
        0.03,
        description="Frames up to this long after the closest approach enter E; null: the whole motion. "
        "Raise it to fit the swing after the hit, too; use null to reproduce the paper.",
    )
    contact_radius_m: Annotated[float, Field(gt=0, le=0.5)] | None = Field(
        0.02,
        description="A throw with at most this miss may touch what stands at the target: its frames after "
        "the closest approach do not enter E. Set it to the radius of what stands there, or to null if "
        "nothing solid does.",
    )
    joints: Literal["measured", "commanded"] = Field(
        "measured",
        description="Drive the simulated hand with the measured or with the commanded joint angles. Use "
        "commanded only to reproduce the paper.",
    )
    ensemble: Annotated[int, Field(ge=1, le=64)] = Field(
        6,
        description="Number of near-best strings that are kept beside the best one; the planner uses "
        "them. Raise it for a better picture of what the data leave open.",
    )
    profiles: bool = Field(
        True,
        description="Find how far each number may move while E rises by 10 %, all others fitted again. Set "
        "it to false to save time if you do not read the parameters.",
    )
    paper: PaperSearch = Field(PaperSearch(), description="Settings of `search: paper`.")

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
            known_parameters(value)
            bad = [name for name, (low, high) in value.items() if not 0 < low < high]
            if bad:
                raise ValueError(f"the range of {bad[0]} must be [least, greatest], both above 0")
        return value
