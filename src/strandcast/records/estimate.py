"""estimate.json, ensemble.parquet and simulated.parquet: the string that explains the throws so far."""

from __future__ import annotations

from typing import ClassVar

from strandcast.records.motion import StringSet
from strandcast.records.record import Part, Record
from strandcast.records.tables import Column, TableSpec

# One row per member; a float column per parameter and per mass (`mass_1`…`mass_n`) follows.
ENSEMBLE = TableSpec(
    "strandcast/ensemble", {"member": Column("i4", "1"), "E_m": Column("f8", "m")}, open_ended=True
)

SIMULATED = TableSpec(
    "strandcast/simulated",
    {
        "source": Column("str", "1"),  # "planned" or "fitted"
        "frame": Column("i4", "1"),
        "robot_time_s": Column("f8", "s"),
        "point": Column("i4", "1"),
        "x_m": Column("f8", "m"),
        "y_m": Column("f8", "m"),
    },
)


class ParameterFit(Part):
    """One estimated number, where it lies in its range, and how far the near-best ones spread."""

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
    """The relative mass found for a weight or a stiff section at a known place."""

    place_m: float
    kind: str  # "weight" or "stiff"
    value: float
    minimum: float
    maximum: float
    at_bound: bool
    ensemble_low: float
    ensemble_high: float


class Knowledge(Part):
    """How well the d unknowns are known, in the order of `unknowns`.

    Standard deviations are in decades, or in the number's own unit where it may be negative (`in_decades`).
    A profile's ends are values at which the best E that all other unknowns allow is higher by the share
    `profile_rise`; null without profiles. `open`: it goes on beyond that end, at least to the range's bound.
    """

    unknowns: list[str]
    in_decades: list[bool]
    conditional_sd: list[float]  # all others known
    marginal_sd: list[float]  # nothing known but the ranges
    correlation: list[list[float]]
    noise_m: float  # standard deviation of a coordinate of the residuals
    measurements_per_datum: float  # neighbours in time and along the string err alike
    gauge_fixed: bool  # the scale common to masses and coefficients, by plain points of mass 1
    profile_rise: float
    profile_low: list[float | None]
    profile_high: list[float | None]
    profile_low_open: list[bool]
    profile_high_open: list[bool]


class Step(Part):
    """One point of the convergence curve."""

    evaluations: int
    best_m: float


class ServoFit(Part):
    """How the joints follow their commands: second order with a delay, joint by joint.

    The lag, delay and time constant together, is known better than either. `held_out`: predictions of motion
    that was not fitted.
    """

    delay_s: list[float]
    natural_frequency_rad_s: list[float]
    damping_ratio: list[float]
    gain: list[float]  # as planned with: the arm's file's
    residual_rad: list[float | None]
    delay_sd_s: list[float | None] | None = None
    time_constant_s: list[float] | None = None
    time_constant_sd_s: list[float | None] | None = None
    lag_s: list[float] | None = None
    lag_sd_s: list[float | None] | None = None
    fitted_gain: list[float | None] | None = None  # of a second fit, not used
    fitted_gain_sd: list[float | None] | None = None
    held_out: str | None = None  # what was held out
    held_out_rad: list[float | None] | None = None  # rms by joint
    held_out_hand_m: float | None = None  # rms distance of the hand


class HeldOut(Part):
    """E on data that the fit has not seen."""

    what: str
    E_m: float


class Estimate(Record):
    """The fit after one trial, on the trials so far."""

    SCHEMA: ClassVar[str] = "strandcast/estimate"

    experiment: str
    trial: int
    trials_used: list[int]
    length_m: float
    points: int
    reading: str
    integrator: str
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
    options: dict[str, float] = {}  # further fitted numbers, e.g. rest curl, turn of the clamp
    frames_used: int
    E_planned_m: float | None  # this trial under the parameters that planned it
    E_m: float  # this trial after the fit; w = 0
    E_weighted_m: float
    E_points_m: list[float | None]  # E_i of points 1…n
    step_change_m: float | None = None  # what half the step changes in the fitted string
    rmse_m: float
    tip_error_m: float | None  # none where the tip was not seen
    held_out: list[HeldOut]
    convergence: list[Step]
    evaluations: int
    rejected: int  # draws that blew up or overstretched
    converged: bool | None = None  # whether nothing gained any more before the evaluations were spent
    knowledge: Knowledge | None = None
    servo: ServoFit | None
    planned_from: dict[str, str]  # files read -> content hash
    warnings: list[str]
