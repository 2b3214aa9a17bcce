"""One trial read back: what estimate and plan know of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.arm.load import Arm
from strandcast.arm.response import Response, identify_response
from strandcast.estimation.space import Strings, with_options
from strandcast.records.alignment import Alignment, read_hand
from strandcast.records.estimate import ENSEMBLE
from strandcast.records.joint_log import JointLog, read_run
from strandcast.records.motion import Motion
from strandcast.records.summary import AFTER_MOTION_S, Verdict
from strandcast.records.tables import read_table
from strandcast.records.track import Track, read_track
from strandcast.stages.context import Context, free_length_m
from strandcast.string.masses import MassLayout, mass_layout
from strandcast.string.model import StringModel
from strandcast.string.parameters import PARAMETERS


@dataclass(frozen=True, eq=False)
class Trial:
    """A trial on the robot's clock: track, hand, verdict; if it was played, its motion and joint log."""

    number: int
    track: Track
    alignment: Alignment
    verdict: Verdict
    frame_time_s: np.ndarray
    hand_time_s: np.ndarray
    hand_pose: np.ndarray
    motion: Motion | None
    log: JointLog | None


def read_trial(context: Context, number: int) -> Trial:
    """Read one trial's results, and the motion and log beside its raw files where there are such."""
    folder = context.folder.trial(number)
    track = read_track(folder.results / "track.parquet", context.settings.string.n)
    alignment = Alignment.read(folder.results / "alignment.json")
    hand_time_s, hand_pose = read_hand(folder.results / "hand.parquet", context.settings.estimate.joints)
    played = folder.played_motion
    return Trial(
        number,
        track,
        alignment,
        Verdict.read(folder.results / "verdict.json"),
        alignment.robot_time_s(track.camera_time_s),
        hand_time_s,
        hand_pose,
        Motion.read(played) if played else None,
        read_run(folder.data)[1] if (folder.data / "run.json").is_file() else None,
    )


def read_members(path: Path, layout: MassLayout) -> Strings:
    """Read an ensemble as a batch of strings."""
    rows = read_table(path, ENSEMBLE)
    points = sum(name.startswith("mass_") for name in rows)

    def columns(stem: str, count: int) -> np.ndarray:
        values = [rows[f"{stem}_{k + 1}"] for k in range(count)]
        return np.array(values).reshape(count, -1).T if count else np.zeros((len(rows["member"]), 0))

    return with_options(
        np.array([rows[name] for name in PARAMETERS]).T,
        columns("mass", points),
        columns("weight", layout.count),
        rows,
        layout,
    )


def string_model(context: Context, arm: Arm) -> tuple[StringModel, MassLayout]:
    """Return the model of the experiment's string, without what the clamp swallows, and its mass layout."""
    string, estimate = context.settings.string, context.settings.estimate
    length_m = free_length_m(context, arm.clamp.swallowed_m)
    model = StringModel(length_m, string.n, estimate.reading, estimate.integrator, estimate.dt_s)
    layout = mass_layout(
        length_m,
        string.n,
        [min(weight.place_m, length_m) for weight in string.weights],
        [(section.from_m, min(section.to_m, length_m)) for section in string.stiff_sections],
    )
    return model, layout


def servo_of(arm: Arm, trials: list[Trial]) -> Response | None:
    """Identify the servo's response from the trials' joint logs; None if no log tells its commands."""
    step_s = 1.0 / arm.log_rate_hz
    told = [_told_and_done(arm, trial, step_s) for trial in trials if trial.log is not None]
    pairs = [pair for pair in told if pair is not None]
    if not pairs:
        return None
    same = [pair for pair in pairs if pair[0].shape == pairs[-1][0].shape]
    time_s = np.arange(len(same[0][0])) * step_s
    return identify_response(
        time_s, np.array([pair[0] for pair in same]), np.array([pair[1] for pair in same]), arm.servo
    )


def _told_and_done(arm: Arm, trial: Trial, step_s: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Return commanded and measured joints (T, J), from the motion's start until a little after its end."""
    log = trial.log
    assert log is not None
    columns = [log.joint_names.index(name) for name in arm.joints]
    told = np.isfinite(log.q_cmd_rad[:, columns]).all(axis=1)
    if not told.any():
        return None
    start_s, end_s = trial.alignment.motion_start_s, trial.alignment.motion_end_s + AFTER_MOTION_S
    time_s = start_s + np.arange(round((end_s - start_s) / step_s) + 1) * step_s

    def resampled(rows: np.ndarray, values: np.ndarray) -> np.ndarray:
        known = values[rows][:, columns]
        return np.stack([np.interp(time_s, log.time_s[rows], joint) for joint in known.T], axis=1)

    return resampled(told, log.q_cmd_rad), resampled(np.ones_like(told), log.q_rad)
