"""The string that explains the trials so far: estimate.json, ensemble.parquet, simulated.parquet."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import Arm, load_arm
from strandcast.arm.response import HeldOut as Predicted
from strandcast.arm.response import Response
from strandcast.errors import StrandcastError
from strandcast.estimation.estimate import Fit, estimate
from strandcast.estimation.knowledge import RISE
from strandcast.estimation.settings import FitSettings
from strandcast.estimation.space import Space, Strings, options_of, with_options
from strandcast.estimation.throw import Throw
from strandcast.experiment import EstimateSettings
from strandcast.records.estimate import (
    ENSEMBLE,
    SIMULATED,
    Estimate,
    HeldOut,
    Knowledge,
    ParameterFit,
    ServoFit,
    Step,
    WeightFit,
)
from strandcast.records.files import sha256_file
from strandcast.records.motion import Motion, StringSet
from strandcast.records.summary import AFTER_MOTION_S
from strandcast.records.tables import write_table
from strandcast.records.track import UNSURE
from strandcast.seeds import rng, seed_of
from strandcast.stages.context import Context, context_of
from strandcast.stages.trials import Trial, read_members, read_trial, servo_of, string_model
from strandcast.string.masses import MassLayout
from strandcast.string.model import StringModel
from strandcast.string.parameters import PARAMETERS, UNITS

DOUBT_M = 0.003  # of a place: its weight in E halves at this sigma
UNSURE_WEIGHT = 0.25
SAME_PASS_S = 0.1  # between the planned hit and the closest approach


def run(root: Path, name: str, trial: int) -> None:
    """Estimate the string after one trial."""
    context = context_of(root, name)
    settings = context.settings.estimate
    arm = load_arm(context.arm_file)
    model, layout = string_model(context, arm)
    earlier = context.counted_before(trial)
    trials = [read_trial(context, number) for number in [*earlier, trial]]
    _refuse_blind(context, trials[-1])
    previous = _previous(context, earlier, layout)
    fit = estimate(
        [throw_of(t, settings) for t in trials],
        model,
        layout,
        _fit_settings(settings, layout),
        rng(name, context.settings.seed, trial, "estimate"),
        planned=_planned(trials[-1].motion, layout),
        previous=previous,
    )
    response = servo_of(arm, trials)
    servo = None if response is None else _servo(arm, response)
    record = _record(context, model, layout, trials, fit, servo)
    folder = context.folder.trial(trial).results
    write_table(folder / "ensemble.parquet", ENSEMBLE, _members(fit))
    write_table(folder / "simulated.parquet", SIMULATED, _simulated(fit, trials[-1]))
    record.write(folder / "estimate.json")


def _refuse_blind(context: Context, trial: Trial) -> None:
    if np.isfinite(trial.track.points_m[:, 1:]).any():
        return
    raise StrandcastError(
        "SC-E001",
        "no point of the string is in the track",
        file=context.folder.trial(trial.number).results / "track.parquet",
        fix=f"look at the track's report; exclude trial {trial.number} with a reason",
    )


def throw_of(trial: Trial, settings: EstimateSettings) -> Throw:
    """Return a trial as the estimation wants it: only what was seen, weighted by its certainty."""
    track = trial.track
    confidence = 1.0 / (1.0 + (np.nan_to_num(track.sigma_m) / DOUBT_M) ** 2)
    confidence = np.where((track.flags & UNSURE) > 0, UNSURE_WEIGHT * confidence, confidence)
    used = trial.frame_time_s <= _until_s(trial, settings)
    return Throw(trial.frame_time_s, track.seen_m(), trial.hand_time_s, trial.hand_pose, used, confidence)


def _until_s(trial: Trial, settings: EstimateSettings) -> float:
    """Return the robot time of the last frame that enters E: what comes after a touch is another motion.

    A miss may have been nearest long before or after the pass that was planned; it is that pass that teaches.
    """
    closest_s, expected_s = trial.verdict.closest_robot_time_s, _expected_s(trial)
    if trial.verdict.hit and closest_s is not None:
        return closest_s
    known_s = [s for s in (closest_s, expected_s) if s is not None]
    if settings.horizon_s is None or not known_s:
        return trial.alignment.motion_end_s + AFTER_MOTION_S
    if len(known_s) == 2 and abs(known_s[0] - known_s[1]) > SAME_PASS_S:
        return known_s[1] + settings.horizon_s
    return max(known_s) + settings.horizon_s


def _expected_s(trial: Trial) -> float | None:
    """Return the robot time at which the motion was planned to hit."""
    if trial.motion is None or trial.motion.predicted is None:
        return None
    return trial.alignment.motion_start_s + trial.motion.predicted.hit_time_s


def _fit_settings(settings: EstimateSettings, layout: MassLayout) -> FitSettings:
    return FitSettings(
        search=settings.search,
        evaluations=settings.evaluations,
        trials=settings.trials,
        older_trials_weight=settings.older_trials_weight,
        evaluation=settings.evaluation,
        w=settings.w,
        ranges=settings.ranges,
        start_shape=settings.start_shape,
        rest_curl=settings.rest_curl,
        clamp_offset=settings.clamp_offset,
        clamp_offset_sd_rad=settings.clamp_offset_sd_rad,
        camera_offset_sd_m=settings.camera_offset_sd_m,
        stiff_bend=settings.stiff_bend,
        bend_friction=settings.bend_friction,
        find_weights=settings.find_weights,
        plain_mass=settings.search == "paper" and layout.count > 0,
        ensemble=settings.ensemble,
        profiles=settings.profiles,
        centre=settings.paper.centre,
        chi_0=settings.paper.chi_0,
        beta=settings.paper.beta,
    )


def _planned(motion: Motion | None, layout: MassLayout) -> Strings | None:
    """Return the string that the motion was planned with."""
    if motion is None or motion.provenance is None:
        return None
    string = motion.provenance.string
    return with_options(
        np.array([[string.parameters[name] for name in PARAMETERS]]),
        np.array([string.masses]),
        np.ones((1, layout.count)),
        {name: np.array([value]) for name, value in string.options.items()},
        layout,
    )


def _previous(context: Context, earlier: list[int], layout: MassLayout) -> Strings | None:
    """Return the ensemble of the estimate before this one, the best first."""
    if not earlier:
        return None
    return read_members(context.folder.trial(earlier[-1]).results / "ensemble.parquet", layout)


def _members(fit: Fit) -> dict[str, np.ndarray]:
    strings = fit.members
    columns = {"member": np.arange(len(strings)), "E_m": fit.member_values_m}
    columns |= dict(zip(PARAMETERS, strings.parameters.T, strict=True))
    columns |= {f"mass_{k + 1}": mass for k, mass in enumerate(strings.masses.T)}
    columns |= {f"weight_{k + 1}": mass for k, mass in enumerate(strings.free_masses.T)}
    return columns | options_of(strings)


def _simulated(fit: Fit, trial: Trial) -> dict[str, np.ndarray]:
    paths = [("planned", fit.planned_m), ("fitted", fit.fitted_m)]
    tables = [_long(name, points, fit, trial) for name, points in paths if points is not None]
    return {column: np.concatenate([table[column] for table in tables]) for column in tables[0]}


def _long(source: str, points_m: np.ndarray, fit: Fit, trial: Trial) -> dict[str, np.ndarray]:
    frame, point = np.nonzero(np.isfinite(points_m).all(axis=2))
    return {
        "source": np.full(len(frame), source, dtype=object),
        "frame": trial.track.frame[fit.frames[frame]],
        "robot_time_s": fit.time_s[frame],
        "point": point,
        "x_m": points_m[frame, point, 0],
        "y_m": points_m[frame, point, 1],
    }


def _record(
    context: Context,
    model: StringModel,
    layout: MassLayout,
    trials: list[Trial],
    fit: Fit,
    servo: ServoFit | None,
) -> Estimate:
    settings, seed = context.settings.estimate, context.settings.seed
    newest = trials[-1]
    kept = [t.number for t, weight in zip(trials, fit.trial_weights, strict=True) if weight > 0]
    return Estimate(
        experiment=context.name,
        trial=newest.number,
        trials_used=kept,
        length_m=model.length_m,
        points=model.points,
        reading=model.reading,
        integrator=model.integrator,
        dt_s=model.dt_s,
        search=settings.search,
        ranges=settings.ranges if isinstance(settings.ranges, str) else "given",
        start_shape=settings.start_shape,
        evaluation=settings.evaluation,
        w=settings.w,
        seed=seed_of(context.name, seed, newest.number, "estimate"),
        string=string_set(fit.best),
        parameters=[_parameter(fit, k) for k in range(len(PARAMETERS))],
        weights=_weights(context, fit, layout),
        options={
            name: float(fit.space.values(fit.chi)[k])
            for k, name in enumerate(fit.space.names)
            if k >= len(PARAMETERS) + layout.count
        },
        frames_used=fit.frames_used,
        E_planned_m=_finite(fit.E_planned_m),
        E_m=fit.E_m,
        E_weighted_m=fit.E_weighted_m,
        E_points_m=[_finite(value) for value in fit.E_points_m],
        step_change_m=_finite(fit.step_change_m),
        rmse_m=fit.rmse_m,
        tip_error_m=_finite(fit.tip_error_m),
        held_out=[HeldOut(what=h.what, E_m=h.E_m) for h in fit.held_out if np.isfinite(h.E_m)],
        convergence=[
            Step(evaluations=int(count), best_m=float(best))
            for count, best in zip(*fit.convergence, strict=True)
            if np.isfinite(best)
        ],
        evaluations=fit.evaluations,
        rejected=fit.rejected,
        converged=fit.converged,
        knowledge=_knowledge(fit),
        servo=servo,
        planned_from=_read_files(context, [t.number for t in trials]),
        warnings=list(fit.warnings),
    )


def string_set(string: Strings) -> StringSet:
    """Return the first string of a batch as it is written down."""
    return StringSet(
        parameters=dict(zip(PARAMETERS, string.parameters[0].tolist(), strict=True)),
        masses=string.masses[0].tolist(),
        options={name: float(values[0]) for name, values in options_of(string).items()},
    )


def _parameter(fit: Fit, k: int) -> ParameterFit:
    name = fit.space.names[k]
    return ParameterFit(name=name, unit=UNITS[name], **_range(fit.space, fit, k))


def _range(space: Space, fit: Fit, k: int) -> dict[str, float]:
    return {
        "value": float(space.values(fit.chi)[k]),
        "exponent": float(fit.chi[k]),
        "minimum": float(space.bounds[k, 0]),
        "maximum": float(space.bounds[k, 1]),
        "at_bound": bool(fit.at_bound[k]),
        "ensemble_low": float(fit.low[k]),
        "ensemble_high": float(fit.high[k]),
    }


def _weights(context: Context, fit: Fit, layout: MassLayout) -> list[WeightFit]:
    found = []
    weights = len(context.settings.string.weights)
    for k in range(layout.count):
        numbers = _range(fit.space, fit, len(PARAMETERS) + k)
        numbers.pop("exponent")
        found.append(
            WeightFit(place_m=float(layout.places_m[k]), kind="weight" if k < weights else "stiff", **numbers)
        )
    return found


def _knowledge(fit: Fit) -> Knowledge:
    """Return what is known of the unknowns, as values: decades, or their own units."""
    known, space = fit.knowledge, fit.space
    linear = space.is_linear()
    width = np.where(linear, space.bounds[:, 1] - space.bounds[:, 0], known.decades)
    return Knowledge(
        unknowns=list(space.names),
        in_decades=np.logical_not(linear).tolist(),
        conditional_sd=(known.conditional * width).tolist(),
        marginal_sd=(known.marginal * width).tolist(),
        correlation=np.round(known.correlation, 4).tolist(),
        noise_m=known.noise_m,
        measurements_per_datum=known.per_datum,
        gauge_fixed=known.gauge_fixed,
        profile_rise=RISE,
        profile_low=[_finite(value) for value in space.values(known.low)],
        profile_high=[_finite(value) for value in space.values(known.high)],
        profile_low_open=known.open_low.tolist(),
        profile_high_open=known.open_high.tolist(),
    )


def _servo(arm: Arm, response: Response) -> ServoFit:
    servo, held_out = response.servo, response.held_out
    return ServoFit(
        delay_s=servo.delay_s.tolist(),
        natural_frequency_rad_s=servo.natural_frequency_rad_s.tolist(),
        damping_ratio=servo.damping_ratio.tolist(),
        gain=servo.gain.tolist(),
        residual_rad=_known(response.residual_rad),
        delay_sd_s=_known(response.delay_sd_s),
        time_constant_s=servo.time_constant_s.tolist(),
        time_constant_sd_s=_known(response.time_constant_sd_s),
        lag_s=servo.lag_s.tolist(),
        lag_sd_s=_known(response.lag_sd_s),
        fitted_gain=_known(response.gain),
        fitted_gain_sd=_known(response.gain_sd),
        held_out=None if held_out is None else held_out.what,
        held_out_rad=None if held_out is None else _known(held_out.error_rad),
        held_out_hand_m=None if held_out is None else _finite(_hand_error_m(arm, held_out)),
    )


def _known(values: np.ndarray) -> list[float | None]:
    """Return numbers as a record takes them: None for what a joint that stood still does not tell."""
    return [_finite(float(value)) for value in values]


def _hand_error_m(arm: Arm, held_out: Predicted) -> float:
    """Return how far predicted joints take the hand from where the measured ones did, rms [m]."""
    predicted, measured = (
        hand_pose(arm.chain, arm.clamp, q)[:, :2] for q in (held_out.predicted_rad, held_out.measured_rad)
    )
    return float(np.sqrt(np.nanmean(((predicted - measured) ** 2).sum(axis=1))))


def _read_files(context: Context, numbers: list[int]) -> dict[str, str]:
    """Return the hashes of the files that the fit was made from, by their place in the results."""
    files = {}
    for number in numbers:
        folder = context.folder.trial(number).results
        for file in ("track.parquet", "alignment.json", "hand.parquet", "verdict.json"):
            files[f"{folder.name}/{file}"] = sha256_file(folder / file)
    return files


def _finite(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(value)
