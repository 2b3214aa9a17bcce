"""estimate.json, ensemble.parquet and simulated.parquet: the string that explains the throws so far."""

from collections.abc import Mapping
from typing import Any, ClassVar

from strandcast.core.strings import FORCES, ForceName
from strandcast.records.motion import StringSet
from strandcast.records.record import Migration, Part, Record, RigFault
from strandcast.records.tables import Column, TableSpec

# One row per member of the ensemble; a float column per parameter and per mass (`mass_1`…`mass_n`) follows.
ENSEMBLE = TableSpec(
    "strandcast/ensemble", {"member": Column("i4", "1"), "E_m": Column("f8", "m")}, open_ended=True
)

SIMULATED = TableSpec(
    "strandcast/simulated",
    {
        # "planned" or "fitted"; without a target, and in space, "predicted" by the estimate before. In space
        # these are the markers, and "string" and "predicted_string" have the mass points.
        "source": Column("str", "1"),
        "frame": Column("i4", "1"),
        "robot_time_s": Column("f8", "s"),
        "point": Column("i4", "1"),
        "x_m": Column("f8", "m"),
        "y_m": Column("f8", "m"),
    },
    optional={"z_m": Column("f8", "m")},
)


class ParameterFit(Part):
    """One estimated parameter: its value, its place in its range, and its range over the ensemble."""

    name: str
    unit: str
    value: float
    exponent: float  # χ of eq. 2, 0 at the minimum, 1 at the maximum
    minimum: float
    maximum: float
    at_bound: bool
    ensemble_low: float
    ensemble_high: float


class WeightFit(Part):
    """The estimated relative mass of a weight or a stiff section at a known place.

    `interval` is that of the uncertainty; null without profiles, its ends null where it is open. `known`: it
    has both ends, within a factor of three of its middle, and the independent searches agree.
    """

    place_m: float
    kind: str  # "weight" or "stiff"
    value: float
    minimum: float
    maximum: float
    at_bound: bool
    ensemble_low: float
    ensemble_high: float
    interval: list[float | None] | None = None
    known: bool | None = None
    plain_kg: float | None = None  # mass of a plain point; null without `string.mass_per_length_kg_m`

    @property
    def words(self) -> str:
        """The mass and its interval, or that it is not known."""
        if self.known is None or self.interval is None:
            return self._mass(self.value)
        low, high = (None if end is None else self._mass(end) for end in self.interval)
        if self.known:
            return f"{self._mass(self.value)} [{low}, {high}]"
        return f"not known from these data: {low or 'nothing'} to {high or 'any mass'} may be true"

    def _mass(self, value: float) -> str:
        """Return a mass in kilograms, or in those of a plain point."""
        return f"{value:.3g} plain points" if self.plain_kg is None else f"{value * self.plain_kg:.3g} kg"


class ParameterUncertainty(Part):
    """Uncertainty of the estimate's d unknowns, in the order of `unknowns`.

    Standard deviations are in decades, or in the number's own unit where it may be negative (`in_decades`).
    A profile ends where E, minimised over all other unknowns, has risen by the fraction `profile_rise`, or
    at the farthest string that the search tried with less E; null without profiles. `open`: the profile
    continues beyond that end, at least to the bound of the range.
    """

    unknowns: list[str]
    in_decades: list[bool]
    conditional_sd: list[float]  # with all others known
    marginal_sd: list[float]  # with only the ranges known
    correlation: list[list[float]]
    noise_m: float  # standard deviation of a coordinate of the residuals
    measurements_per_datum: float  # errors of neighbours in time and along the string are correlated
    gauge_fixed: bool  # the common scale of masses and coefficients is set by plain points of mass 1
    profile_rise: float
    profile_low: list[float | None]
    profile_high: list[float | None]
    profile_low_open: list[bool]
    profile_high_open: list[bool]


class ConvergenceStep(Part):
    """One point of the convergence curve."""

    evaluations: int
    best_m: float


class ServoFit(Part):
    """Servo response of each joint: second order with a delay.

    The lag, the sum of delay and time constant, is known better than either. `held_out`: prediction of motion
    that was not fitted.
    """

    delay_s: list[float]
    natural_frequency_rad_s: list[float]
    damping_ratio: list[float]
    gain: list[float]  # used for planning, from the arm's file
    residual_rad: list[float | None]
    delay_sd_s: list[float | None] | None = None
    time_constant_s: list[float] | None = None
    time_constant_sd_s: list[float | None] | None = None
    lag_s: list[float] | None = None
    lag_sd_s: list[float | None] | None = None
    fitted_gain: list[float | None] | None = None  # from a second fit; not used
    fitted_gain_sd: list[float | None] | None = None
    held_out: str | None = None  # which data were held out
    held_out_rad: list[float | None] | None = None  # rms per joint
    held_out_hand_m: float | None = None  # rms distance at the hand


# `what` of errors that pages look for: this trial under the string fitted before it was added, and where the
# string would be if it hung straight below the hand, or kept its first shape and moved with the hand.
UNDER_PREVIOUS = "this throw under the estimate before it"
TIP_UNDER_PREVIOUS = "its last marker under the estimate before it, mean distance"
LAST_PART = "the last quarter of the trial, simulated from its beginning, from a fit to the rest"
HANGING, CARRIED = "no model: hanging straight below the hand", "no model: first shape, moved with the hand"


class HeldOutError(Part):
    """E on data held out from the fit."""

    what: str
    E_m: float


class ForceTried(Part):
    """An optional force that the fit tried, see `strandcast.core.strings.FORCES`, and what it is worth.

    Costs of the best string and E of parts that were not fitted, without and with it; and the standard error
    of that difference. None: it is kept from the estimate before, or the cost fell too little.
    """

    name: ForceName
    kept: bool
    cost_m: list[float] | None = None
    held_out_m: list[float] | None = None
    gain_sd_m: float | None = None

    @property
    def words(self) -> str:
        """The force in words."""
        return FORCES[self.name].words


class RigOffset(Part):
    """One number of the arm's file: its deviation from the file, the same in all trials [m or rad].

    `value` and `sd` are by the trials alone; None where they do not tell this number from others. `hand_m` is
    the farthest that it moves the hand, should it be wrong. `state` is wrong, possible (something is wrong,
    and the motions do not tell what), or right.
    """

    name: str
    unit: str
    value: float | None
    sd: float | None
    hand_m: float
    wrong_probability: float | None = None  # that it is not right to within half a millimetre or milliradian
    state: str
    says: str
    fix: str


class RigOffsets(Part):
    """What the trials show of the arm's file: what it states wrongly, in the same way in all trials."""

    trials: list[int]
    right_probability: float  # that no number is wrong
    together_m: float  # the farthest that all deviations together move the hand
    zero_scatter_rad: float  # standard deviation of a joint's zero from trial to trial
    numbers: list[RigOffset]
    faults: list[RigFault] = []
    warnings: list[str] = []  # the same in words


class FittedPart(Part):
    """How much of a trial a fit has read."""

    trial: int
    frames: int
    seconds: float
    recorded_frames: int
    recorded_s: float


def _with_uncertainty(content: dict[str, Any]) -> dict[str, Any]:
    """Return content of version 2: `knowledge` is called `uncertainty`."""
    return {"uncertainty" if name == "knowledge" else name: value for name, value in content.items()}


class Estimate(Record):
    """The fit after one trial, on this and the trials before it."""

    SCHEMA: ClassVar[str] = "strandcast/estimate"
    VERSION: ClassVar[int] = 2
    MIGRATIONS: ClassVar[Mapping[int, Migration]] = {1: _with_uncertainty}

    experiment: str
    trial: int
    trials_used: list[int]
    length_m: float
    points: int
    reading: str
    dt_s: float
    search: str
    ranges: str
    start_shape: str
    evaluation: str  # "world" or "hand"
    w: float
    seed: int
    string: StringSet
    parameters: list[ParameterFit]
    weights: list[WeightFit]
    options: dict[str, float] = {}  # other fitted numbers, e.g. rest curl, clamp angle
    forces: list[ForceTried] = []
    undetermined: dict[str, str] = {}  # of captures: unknowns that they leave open -> the motion that does
    frames_used: int
    window_s: list[float] | None = None  # robot time of the first and the last of them
    # In space, what was fitted of each trial; `frames_used`, `window_s` and E are of the whole newest one.
    fitted: list[FittedPart] = []
    E_planned_m: float | None  # this trial with the parameters that planned it
    E_m: float  # this trial after the fit; w = 0
    E_weighted_m: float
    E_points_m: list[float | None]  # E_i of points 1…n
    step_change_m: float | None = None  # change of the fitted motion when the time step is halved
    rmse_m: float
    tip_error_m: float | None  # null if the tip was not detected
    held_out: list[HeldOutError]
    convergence: list[ConvergenceStep]
    evaluations: int
    rejected: int  # candidates that diverged or overstretched
    converged: bool | None = None  # whether the search stopped improving before its evaluations ran out
    uncertainty: ParameterUncertainty | None = None
    servo: ServoFit | None
    rig_offsets: RigOffsets | None = None  # from two trials with a joint log on
    planned_from: dict[str, str]  # files read -> content hash
    warnings: list[str]
    faults: list[RigFault] = []  # of the declared weights, which the warnings name too

    def held_out_m(self, what: str) -> float | None:
        """Return E on the data that `what` names; None where it is not known."""
        return next((held.E_m for held in self.held_out if held.what == what), None)

    def undetermined_in_words(self) -> str | None:
        """Return which unknowns the recordings leave open, and which motions would determine them."""
        if not self.undetermined:
            return None
        found: dict[str, list[str]] = {}
        for name, motion in self.undetermined.items():
            found.setdefault(motion, []).append(name)
        words = [f"{motion} should narrow {', '.join(names)}" for motion, names in found.items() if motion]
        left = f"within a factor of three, these recordings do not determine {', '.join(self.undetermined)}"
        return "; ".join([left, *words])

    def fitted_in_words(self) -> str | None:
        """Return how much of the trials the fit has read; None where it has read all that E is of."""
        if not self.fitted:
            return None
        counts = [(each.seconds, each.recorded_s, each.frames, each.recorded_frames) for each in self.fitted]
        seconds, recorded_s, frames, recorded = (sum(column) for column in zip(*counts, strict=True))
        return f"{seconds:.1f} of {recorded_s:.1f} s, {frames} of {recorded} frames"
