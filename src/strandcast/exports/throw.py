"""One throw as arrays on the robot's clock, as all exports of recordings take it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.api import TrialView
from strandcast.arm.kinematics import hand_pose, link_points
from strandcast.arm.load import PlanarArm, load_arm
from strandcast.core.interpolation import resampled
from strandcast.core.trial_names import trial_digits
from strandcast.errors import StrandcastError
from strandcast.records.joint_log import JointLog
from strandcast.records.track import is_in_space
from strandcast.stages.declarations import STAGES
from strandcast.stages.job import Files, Job
from strandcast.stages.past_trials import read_trial


@dataclass(frozen=True, eq=False)
class ThrowData:
    """A measured throw: F frames of n + 1 points, T samples of J joints.

    Attributes
    ----------
    name
        Experiment and trial, e.g. ``demo-01``.
    frame, camera_time_s, robot_time_s
        (F,) number of each tracked frame in the video, and its mid-exposure on both clocks.
    points_m
        (F, n+1, 2) detected points, NaN where not detected.
    fitted_m
        (F, n+1, 2) the fitted string, NaN where it was not simulated.
    arm
        The arm, with the names of its joints and the plane of motion.
    joint_time_s, q_rad, q_cmd_rad
        (T,), (T, J), (T, J): the joint log on the robot's clock; T = 0 without one.
    target_m
        (2,) the experiment's target, None if it has none.
    video
        The video; None for an imported track.
    """

    name: str
    frame: np.ndarray
    camera_time_s: np.ndarray
    robot_time_s: np.ndarray
    points_m: np.ndarray
    fitted_m: np.ndarray
    arm: PlanarArm
    joint_time_s: np.ndarray
    q_rad: np.ndarray
    q_cmd_rad: np.ndarray
    target_m: np.ndarray | None
    video: Path | None

    def in_space(self, points_m: np.ndarray) -> np.ndarray:
        """Return points (..., 2) of the plane in the frame of the arm's base: (..., 3)."""
        return np.asarray(points_m @ self.arm.plane)

    def arm_m(self, q_rad: np.ndarray) -> np.ndarray:
        """Return the arm's joints and its hand (..., J+2, 2) at angles (..., J)."""
        hand = hand_pose(self.arm.chain, self.arm.clamp, q_rad).position_m
        return np.concatenate([link_points(self.arm.chain, q_rad), hand[..., None, :]], axis=-2)

    def joints_at(self, time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return columns (T, J) of the log at times (K,): (K, J), NaN without a log."""
        if not len(self.joint_time_s):
            return np.full((len(time_s), len(self.arm.joints)), np.nan)
        return resampled(time_s, self.joint_time_s, values)


def read_throw(trial: TrialView) -> ThrowData:
    """Read a trial in the plane that has been estimated."""
    refuse_in_space(trial)
    context = trial.context
    arm = load_arm(context.arm_file).planar()
    measured = read_trial(Files(STAGES["estimate"], Job(context, trial.number)), trial.number)
    track = measured.track
    fitted_m = np.full_like(track.points_m[..., :2], np.nan)
    fitted = trial.simulated.query("source == 'fitted'")
    row = np.searchsorted(track.frame, fitted["frame"].to_numpy())
    fitted_m[row, fitted["point"].to_numpy()] = fitted[["x_m", "y_m"]].to_numpy()
    time_s, q_rad, q_cmd_rad = _joints(arm, measured.log)
    return ThrowData(
        f"{context.name}-{trial_digits(trial.number)}",
        track.frame,
        track.camera_time_s,
        measured.frame_time_s,
        track.detected_m()[..., :2],
        fitted_m,
        arm,
        time_s,
        q_rad,
        q_cmd_rad,
        None if context.settings.target_m is None else np.array(context.settings.target_m),
        trial.folder.video() if trial.folder.videos() else None,
    )


def _joints(arm: PlanarArm, log: JointLog | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if log is None:
        none = np.empty((0, len(arm.joints)))
        return np.empty(0), none, none
    columns = [log.joint_names.index(name) for name in arm.joints]
    # A clock that stood still between two rows would make time run backwards elsewhere.
    rows = np.r_[True, np.diff(log.time_s) > 0]
    return log.time_s[rows], log.q_rad[rows][:, columns], log.q_cmd_rad[rows][:, columns]


def refuse_in_space(trial: TrialView) -> None:
    """Refuse a trial in space (SC-E008): these exports are of the plane."""
    if is_in_space(trial.track.columns):
        what = "the trial is in space, and this export is of one in the plane"
        fix = f"export its tables: strandcast export csv {trial.context.name} {trial.number} --out FOLDER"
        raise StrandcastError("SC-E008", what, file=trial.folder.results / "track.parquet", fix=fix)


def refuse_filled(folder: Path, what: str) -> None:
    """Refuse a folder that is not empty (SC-E005) for what is written whole."""
    if folder.is_dir() and any(folder.iterdir()):
        fix = "give a new folder, or delete this one"
        raise StrandcastError("SC-E005", f"is not empty: {what} is written whole", file=folder, fix=fix)
