"""`export mjcf`: the string fitted after a trial as a MuJoCo model, checked against that trial's track."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.api import TrialView
from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import load_arm
from strandcast.core.strings import CAMERA_OFFSET
from strandcast.dynamics.batch import HANGING_AT_REST, HandPath
from strandcast.dynamics.simulate import simulate_batch
from strandcast.estimation.evaluation import distances, evaluation_of_points, point_values
from strandcast.estimation.measured import prepare
from strandcast.exports.mjcf import STRING_KG, arm_with_string, in_mujoco
from strandcast.exports.mjcf_error import play
from strandcast.records.files import write_bytes
from strandcast.stages.declarations import STAGES
from strandcast.stages.estimate import throw_of
from strandcast.stages.job import Files, Job
from strandcast.stages.past_trials import read_members, read_trial, string_model


@dataclass(frozen=True)
class ExportedModel:
    """An exported model, and E on the trial's track [m]: in MuJoCo (infinite if it diverges), in ours."""

    file: Path
    E_m: float
    own_E_m: float


def export_mjcf(trial: TrialView, out: Path, total_kg: float = STRING_KG) -> ExportedModel:
    """Write the string fitted after a trial, on the experiment's arm, as MJCF.

    Parameters
    ----------
    total_kg
        Mass of the string with all it carries: video and joints cannot show it.
    """
    context = trial.context
    arm, settings = load_arm(context.arm_file).planar(), context.settings.estimate
    model, layout = string_model(context, arm)
    measured = read_trial(Files(STAGES["estimate"], Job(context, trial.number)), trial.number)
    string = read_members(trial.folder.results / "ensemble.parquet", layout).first(1)
    shifted = settings.camera_offset_sd_m is not None
    throw = prepare(
        throw_of(measured, settings), model.places_m(), settings.start_shape, from_measured_hand=shifted
    )
    start_m = simulate_batch(model, string, throw.hand, throw.hand.time_s[:1], throw.start)[0][0, 0]
    plain = in_mujoco(string, model.length_m, float(string.masses.sum()))
    points_m = play(throw, start_m, plain) + np.array([string[name][0] for name in CAMERA_OFFSET])
    apart_m = distances(throw.points_m, points_m, settings.evaluation)
    E_m = float(evaluation_of_points(point_values(apart_m, throw.weight)))
    posture = np.zeros(len(arm.joints))
    if measured.motion is not None:
        posture = measured.motion.trajectory().q_rad[0]
    pose = hand_pose(arm.chain, arm.clamp, posture).array()
    still = HandPath(np.array([0.0, 1.0]), np.stack([pose, pose]))
    at_rest = simulate_batch(model, string, still, np.zeros(1), HANGING_AT_REST)[0][0, 0]
    steps = np.diff(at_rest, axis=0)
    bends = np.diff(np.unwrap(np.r_[pose[2], np.arctan2(steps[:, 1], steps[:, 0])]))
    xml = arm_with_string(arm, in_mujoco(string, model.length_m, total_kg), posture, bends)
    write_bytes(out, xml.encode())
    return ExportedModel(out, E_m if np.isfinite(E_m) else np.inf, trial.estimate.record.E_m)
