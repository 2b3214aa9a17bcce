"""The results of past trials, as estimate and plan read them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.alignment.joints import without_row_noise
from strandcast.arm.load import Arm
from strandcast.arm.servo_response import Response, identify_response
from strandcast.core.strings import PARAMETERS, StringBatch
from strandcast.dynamics.masses import MassLayout, mass_layout
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.schemes.registry import SCHEMES
from strandcast.records.alignment import Alignment, read_hand
from strandcast.records.content_hash import result_sha256
from strandcast.records.estimate import ENSEMBLE
from strandcast.records.joint_log import JointLog, read_run
from strandcast.records.motion import Motion
from strandcast.records.tables import read_table
from strandcast.records.track import Track, TrackSummary, read_track
from strandcast.records.verdict import AFTER_MOTION_S
from strandcast.scoring.measured_misses import Shortfall
from strandcast.scoring.score import tracked_shortfall
from strandcast.stages.context import Context, free_length_m
from strandcast.stages.job import Files


@dataclass(frozen=True, eq=False)
class Trial:
    """A trial on the robot's clock.

    Attributes
    ----------
    aimed
        Whether the experiment has a target.
    shortfall
        The miss; None where it is not known, or without a target. Unlike the verdict, it does not depend on
        the hit radius.
    motion, log
        None if they were not recorded.
    """

    number: int
    summary: TrackSummary
    track: Track
    alignment: Alignment
    aimed: bool
    shortfall: Shortfall | None
    frame_time_s: np.ndarray
    hand_time_s: np.ndarray
    hand_pose: np.ndarray
    motion: Motion | None
    log: JointLog | None


def read_trial(files: Files, number: int) -> Trial:
    """Read one trial's results, and the motion and log beside its raw files if they exist."""
    settings = files.job.context.settings
    track = read_track(files.input("track", number), settings.string.n)
    alignment = Alignment.read(files.input("alignment", number))
    hand_time_s, hand = read_hand(files.input("hand", number), settings.estimate.joints)
    summary = TrackSummary.read(files.input("summary", number))
    shortfall = None
    if settings.aim is not None:
        shortfall, _ = tracked_shortfall(track, alignment, settings.aim, summary.length_m)
    played, run = files.optional("motion", number), files.optional("run", number)
    log = read_run(run.parent)[1] if run else None
    pose = hand.array()
    return Trial(
        number,
        summary,
        track,
        alignment,
        settings.aim is not None,
        shortfall,
        alignment.robot_time_s(track.camera_time_s),
        hand_time_s,
        # The rows' noise would shake the simulated strings.
        without_row_noise(hand_time_s, pose) if log else pose,
        Motion.read(played) if played else None,
        log,
    )


def hashes_of(results: Iterable[Path]) -> dict[str, str]:
    """Return the hashes of result files by their places in the experiment's results."""
    return {f"{path.parent.name}/{path.name}": result_sha256(path) for path in results}


def read_members(path: Path, layout: MassLayout) -> StringBatch:
    """Read an ensemble as a batch of strings."""
    rows = read_table(path, ENSEMBLE)
    points = sum(name.startswith("mass_") for name in rows)

    def columns(stem: str, count: int) -> np.ndarray:
        values = [rows[f"{stem}_{k + 1}"] for k in range(count)]
        return np.array(values).reshape(count, -1).T if count else np.zeros((len(rows["member"]), 0))

    return StringBatch.from_options(
        np.array([rows[name] for name in PARAMETERS]).T,
        columns("mass", points),
        columns("weight", layout.count),
        rows,
        layout.stiff_joints(),
    )


def string_model(
    context: Context, arm: Arm, weights_m: Sequence[float] | None = None
) -> tuple[StringModel, MassLayout]:
    """Return the model of the experiment's string, without its clamped length, and its mass layout.

    `weights_m` are places of weights [m] from the clamp to use instead of the declared ones.
    """
    string, estimate = context.settings.string, context.settings.estimate
    length_m = free_length_m(context, arm.clamp.clamped_length_m)
    SCHEMES.get(estimate.integrator, context.file)
    places_m = [weight.place_m for weight in string.weights] if weights_m is None else weights_m
    model = StringModel(length_m, string.n, estimate.reading, estimate.integrator, estimate.dt_s)
    layout = mass_layout(
        length_m,
        string.n,
        [min(place_m, length_m) for place_m in places_m],
        [(section.from_m, min(section.to_m, length_m)) for section in string.stiff_sections],
    )
    return model, layout


def servo_of(arm: Arm, trials: list[Trial]) -> Response | None:
    """Identify the servo's response from the trials' joint logs; None if no log has the commands."""
    step_s = 1.0 / arm.log_rate_hz
    both = [_commanded_and_measured(arm, trial, step_s) for trial in trials if trial.log is not None]
    pairs = [pair for pair in both if pair is not None]
    if not pairs:
        return None
    same = [pair for pair in pairs if pair[0].shape == pairs[-1][0].shape]
    time_s = np.arange(len(same[0][0])) * step_s
    return identify_response(
        time_s, np.array([pair[0] for pair in same]), np.array([pair[1] for pair in same]), arm.servo
    )


def _commanded_and_measured(arm: Arm, trial: Trial, step_s: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Return commanded and measured joints (T, J), from the motion's start until a little after its end."""
    log = trial.log
    assert log is not None
    columns = [log.joint_names.index(name) for name in arm.joints]
    known = np.isfinite(log.q_cmd_rad[:, columns]).all(axis=1)
    if not known.any():
        return None
    start_s, end_s = trial.alignment.motion_start_s, trial.alignment.motion_end_s + AFTER_MOTION_S
    time_s = start_s + np.arange(round((end_s - start_s) / step_s) + 1) * step_s

    def resampled(rows: np.ndarray, values: np.ndarray) -> np.ndarray:
        given = values[rows][:, columns]
        return np.stack([np.interp(time_s, log.time_s[rows], joint) for joint in given.T], axis=1)

    return resampled(known, log.q_cmd_rad), resampled(np.ones_like(known), log.q_rad)
