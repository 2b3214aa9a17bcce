"""The estimate as files: the record estimate.json, the tables of ensemble.parquet and simulated.parquet."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import PlanarArm
from strandcast.arm.servo_response import HeldOut as Predicted
from strandcast.arm.servo_response import Response
from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import PARAMETERS, StringBatch
from strandcast.dynamics.masses import MassLayout
from strandcast.dynamics.model import StringModel
from strandcast.estimation.evaluation import W
from strandcast.estimation.excitation import FACTOR
from strandcast.estimation.fit import StringFit
from strandcast.estimation.space import Space
from strandcast.estimation.throws import PreparedThrow
from strandcast.estimation.uncertainty import RISE, Uncertainty
from strandcast.records.estimate import (
    ConvergenceStep,
    Estimate,
    HeldOutError,
    ParameterFit,
    ParameterUncertainty,
    ServoFit,
    WeightFit,
)
from strandcast.records.motion import StringSet
from strandcast.records.record import finite
from strandcast.records.track import AXES, Track
from strandcast.seeds import seed_of
from strandcast.stages.context import Context

# By which the known masses of drawn captures are beside their profiles: of places and offsets of markers, the
# length, and a string of few points (docs/explanation/string.md).
MASS_OFF = 1.08


def estimate_record(
    context: Context,
    settings: EstimateSettings,
    model: StringModel,
    layout: MassLayout,
    trials: Sequence[int],
    fit: StringFit,
    planned_from: dict[str, str],
) -> Estimate:
    """Return estimate.json of the newest trial; `planned_from` has the hashes of the files that were read."""
    seed, newest = context.settings.seed, trials[-1]
    kept = [number for number, weight in zip(trials, fit.trial_weights, strict=True) if weight > 0]
    return Estimate(
        experiment=context.name,
        trial=newest,
        trials_used=kept,
        length_m=model.length_m,
        points=model.points,
        reading=model.reading,
        dt_s=model.dt_s,
        search=settings.search,
        ranges=settings.ranges if isinstance(settings.ranges, str) else "given",
        start_shape=settings.start_shape,
        evaluation=settings.evaluation,
        w=W if fit.space.in_plane else 0.0,
        seed=seed_of(context.name, seed, newest, "estimate"),
        string=StringSet.first_of(fit.best),
        parameters=[
            ParameterFit(name=name, unit=unit, **_fitted_range(fit, k))
            for k, (name, unit) in enumerate(fit.space.parameter_units.items())
        ],
        weights=_weight_fits(context, model, fit, layout),
        options={
            name: float(fit.space.values(fit.chi)[k])
            for k, name in enumerate(fit.space.names)
            if k >= len(fit.space.parameter_units) + layout.count
        },
        forces=list(fit.forces),
        undetermined=dict(fit.undetermined),
        frames_used=fit.frames_used,
        window_s=list(fit.window_s),
        E_planned_m=finite(fit.E_planned_m),
        E_m=fit.E_m,
        E_weighted_m=fit.E_weighted_m,
        E_points_m=list(map(finite, fit.E_points_m)),
        step_change_m=finite(fit.step_change_m),
        rmse_m=fit.rmse_m,
        tip_error_m=finite(fit.tip_error_m),
        held_out=[HeldOutError(what=what, E_m=E_m) for what, E_m in fit.held_out.items() if np.isfinite(E_m)],
        convergence=[
            ConvergenceStep(evaluations=int(count), best_m=float(best))
            for count, best in zip(*fit.convergence, strict=True)
            if np.isfinite(best)
        ],
        evaluations=fit.evaluations,
        rejected=fit.rejected,
        converged=fit.converged,
        uncertainty=uncertainty_record(fit),
        servo=None,
        planned_from=planned_from,
        warnings=list(fit.warnings),
    )


def _fitted_range(fit: StringFit, k: int) -> dict[str, float]:
    return {
        "value": float(fit.space.values(fit.chi)[k]),
        "exponent": float(fit.chi[k]),
        "minimum": float(fit.space.bounds[k, 0]),
        "maximum": float(fit.space.bounds[k, 1]),
        "at_bound": bool(fit.at_bound[k]),
        "ensemble_low": float(fit.low[k]),
        "ensemble_high": float(fit.high[k]),
    }


def _weight_fits(context: Context, model: StringModel, fit: StringFit, layout: MassLayout) -> list[WeightFit]:
    found = []
    for k in range(layout.count):
        row = fit.space.names.index(f"weight_{k + 1}")
        numbers = _fitted_range(fit, row)
        numbers.pop("exponent")
        numbers |= mass_known(fit.space, fit.uncertainty, row, agree=fit.searches_agree)
        kind = "weight" if k < len(context.settings.string.weights) else "stiff"
        plain_kg = plain_mass_kg(context, model)
        found.append(WeightFit(place_m=float(layout.places_m[k]), kind=kind, plain_kg=plain_kg, **numbers))
    return found


def plain_mass_kg(context: Context, model: StringModel) -> float | None:
    """Return the mass of a plain point [kg], if the experiment gives the string's mass per length."""
    per_length = context.settings.string.mass_per_length_kg_m
    return None if per_length is None else per_length * model.spacing_m


def mass_known(space: Space, uncertainty: Uncertainty, row: int, *, agree: bool) -> dict[str, Any]:
    """Return `interval` and `known` of `WeightFit` for an unknown; `agree`: of the searches."""
    if not np.isfinite(uncertainty.low[row]):
        return {"interval": None, "known": None}
    low, high = (float(space.values(end)[row]) for end in (uncertainty.low, uncertainty.high))
    ends = [
        None if uncertainty.open_low[row] else low / MASS_OFF,
        None if uncertainty.open_high[row] else high * MASS_OFF,
    ]
    near = high / low <= FACTOR**2  # within that factor of its middle
    return {"interval": ends, "known": agree and near and None not in ends}


def uncertainty_record(fit: StringFit) -> ParameterUncertainty:
    """Return the uncertainty of the unknowns as values: in decades, or in their own units."""
    known, space = fit.uncertainty, fit.space
    linear = space.is_linear()
    width = np.where(linear, space.bounds[:, 1] - space.bounds[:, 0], known.decades)
    return ParameterUncertainty(
        unknowns=list(space.names),
        in_decades=np.logical_not(linear).tolist(),
        conditional_sd=(known.conditional * width).tolist(),
        marginal_sd=(known.marginal * width).tolist(),
        correlation=np.round(known.correlation, 4).tolist(),
        noise_m=known.noise_m,
        measurements_per_datum=known.per_datum,
        gauge_fixed=known.gauge_fixed,
        profile_rise=RISE,
        profile_low=list(map(finite, space.values(known.low))),
        profile_high=list(map(finite, space.values(known.high))),
        profile_low_open=known.open_low.tolist(),
        profile_high_open=known.open_high.tolist(),
    )


def servo_record(arm: PlanarArm, response: Response) -> ServoFit:
    """Return the fitted response of the servos as a record."""
    servo, held_out = response.servo, response.held_out
    return ServoFit(
        delay_s=servo.delay_s.tolist(),
        natural_frequency_rad_s=servo.natural_frequency_rad_s.tolist(),
        damping_ratio=servo.damping_ratio.tolist(),
        gain=servo.gain.tolist(),
        residual_rad=list(map(finite, response.residual_rad)),
        delay_sd_s=list(map(finite, response.delay_sd_s)),
        time_constant_s=servo.time_constant_s.tolist(),
        time_constant_sd_s=list(map(finite, response.time_constant_sd_s)),
        lag_s=servo.lag_s.tolist(),
        lag_sd_s=list(map(finite, response.lag_sd_s)),
        fitted_gain=list(map(finite, response.gain)),
        fitted_gain_sd=list(map(finite, response.gain_sd)),
        held_out=None if held_out is None else held_out.what,
        held_out_rad=None if held_out is None else list(map(finite, held_out.error_rad)),
        held_out_hand_m=None if held_out is None else finite(_hand_error_m(arm, held_out)),
    )


def _hand_error_m(arm: PlanarArm, held_out: Predicted) -> float:
    """Return the distance of the hand at predicted joints from that at the measured ones, rms [m]."""
    predicted, measured = (
        hand_pose(arm.chain, arm.clamp, q).position_m for q in (held_out.predicted_rad, held_out.measured_rad)
    )
    return float(np.sqrt(np.nanmean(((predicted - measured) ** 2).sum(axis=1))))


def ensemble_table(strings: StringBatch, values_m: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns of ensemble.parquet: strings, and the value of the objective (B,) of each."""
    columns = {"member": np.arange(len(strings)), "E_m": values_m}
    columns |= dict(zip(PARAMETERS, strings.parameters.T, strict=True))
    columns |= {f"mass_{k + 1}": mass for k, mass in enumerate(strings.masses.T)}
    columns |= {f"weight_{k + 1}": mass for k, mass in enumerate(strings.free_masses.T)}
    return columns | strings.options()


def points_table(
    paths: list[tuple[str, np.ndarray | None]], fit: StringFit | PreparedThrow, track: Track
) -> dict[str, np.ndarray]:
    """Return the columns of simulated points (G, n+1, 2 or 3) by their source, of those that there are."""
    tables = [_rows_of(name, points, fit, track) for name, points in paths if points is not None]
    return {column: np.concatenate([table[column] for table in tables]) for column in tables[0]}


def _rows_of(
    source: str, points_m: np.ndarray, fit: StringFit | PreparedThrow, track: Track
) -> dict[str, np.ndarray]:
    frame, point = np.nonzero(np.isfinite(points_m).all(axis=2))
    columns = {
        "source": np.full(len(frame), source, dtype=object),
        "frame": track.frame[fit.frames[frame]],
        "robot_time_s": fit.time_s[frame],
        "point": point,
    }
    return columns | dict(zip(AXES, np.moveaxis(points_m[frame, point], -1, 0), strict=False))
