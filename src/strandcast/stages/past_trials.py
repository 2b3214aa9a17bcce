"""The results of past trials, as estimate and plan read them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.alignment.joints import without_row_noise
from strandcast.arm.load import Arm, PlanarArm
from strandcast.arm.servo_response import Response, identify_response
from strandcast.config.estimate import EstimateSettings
from strandcast.core.interpolation import resampled
from strandcast.core.objectives import Objective
from strandcast.core.strings import PARAMETERS, StringBatch
from strandcast.dynamics.masses import FREE_END, MassLayout, mass_layout
from strandcast.dynamics.model import StringModel
from strandcast.estimation.cable_space import THROWN_POINTS, CableSpace, space_of_cable
from strandcast.estimation.unknowns import given_of
from strandcast.records.alignment import Alignment, EndPath, read_hand, read_hand_in_space
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

REST_S = 1.0  # of rest about a motion that its joints' smoothing includes; chosen
SAME_PASS_S = 0.1  # a planned hit and a closest approach this near belong to the same pass of the tip; chosen


@dataclass(frozen=True, eq=False)
class Trial:
    """A trial on the robot's clock.

    Attributes
    ----------
    aim
        The experiment's objective; None without a target.
    motion, log
        None if they were not recorded.
    hand_time_s, hand_pose, ends
        (T,) times of the hand's path, and in the plane (T, 3) x, y and angle, in space the driven ends.
    """

    number: int
    summary: TrackSummary
    track: Track
    alignment: Alignment
    aim: Objective | None
    frame_time_s: np.ndarray
    hand_time_s: np.ndarray
    hand_pose: np.ndarray
    ends: list[EndPath]
    motion: Motion | None
    log: JointLog | None

    def shortfall(self, touch_m: float) -> Shortfall | None:
        """Return the miss once the tip was clear of the target, see `tracked_shortfall`, if it is known."""
        if self.aim is None:
            return None
        return tracked_shortfall(self.track, self.alignment, self.aim, self.summary.length_m, touch_m)[0]


def read_trial(files: Files, number: int, *, in_space: bool | None = None) -> Trial:
    """Read one trial's results, and of a throw the motion and log beside its raw files if they exist.

    `in_space` says where the trial is, None: where the experiment's throws are.
    """
    settings = files.job.context.settings
    thrown = settings.aims_in_space
    in_space = thrown if in_space is None else in_space
    summary = TrackSummary.read(files.input("summary", number))
    track = read_track(files.input("track", number), summary.points if in_space else settings.string.n)
    alignment = Alignment.read(files.input("alignment", number))
    captured = in_space and not thrown
    played, run = (None if captured else files.optional(role, number) for role in ("motion", "run"))
    log = read_run(run.parent)[1] if run else None
    hand_pose: np.ndarray = np.zeros((0, 3))
    ends: list[EndPath] = []
    if in_space:  # without the rows' noise since its import, or smoothed by the fit
        hand_time_s, ends = read_hand_in_space(files.input("hand", number), thrown=thrown)
    else:
        hand_time_s, hand = read_hand(files.input("hand", number), "measured")
        hand_pose = hand.array()
        if log:  # the rows' noise would shake the simulated strings
            near = _near_motion(hand_time_s, alignment.motion_start_s, alignment.motion_end_s)
            hand_time_s = hand_time_s[near]
            hand_pose = without_row_noise(hand_time_s, hand_pose[near])
    return Trial(
        number,
        summary,
        track,
        alignment,
        settings.aim,
        alignment.robot_time_s(track.camera_time_s),
        hand_time_s,
        hand_pose,
        ends,
        Motion.read(played) if played else None,
        log,
    )


def smooth_joints(
    log: JointLog, joints: Sequence[str], motion_s: tuple[float, float], start_s: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return rising times (R,) since `start_s` [s], and angles (R, J) [rad] of a log without its rows' noise.

    Rows far from the motion, which lasts `motion_s` by the log's clock [s], are left out.
    The noise would shake simulated strings, and no track shows what it does to them.
    """
    time_s, q_rad = log.in_order(joints)
    near = _near_motion(time_s, *motion_s)
    since_s = time_s[near] - start_s
    return since_s, without_row_noise(since_s, q_rad[near])


def _near_motion(time_s: np.ndarray, start_s: float, end_s: float) -> np.ndarray:
    """Return which instants (R,) count for a motion: smoothing takes memory by the square of their number."""
    return np.asarray((time_s >= start_s - REST_S) & (time_s <= end_s + AFTER_MOTION_S + REST_S))


def until_s(trial: Trial, settings: EstimateSettings) -> float:
    """Return the robot time of the last frame that enters E.

    Without a target, all frames of the motion do. A touch ends the free motion. After a miss, the closest
    approach may belong to another pass of the tip than the planned one; the fit then uses the planned pass.
    """
    reach_m = settings.contact_radius_m
    nearest, expected_s = trial.shortfall(reach_m or 0.0), _expected_s(trial)
    if nearest is not None and reach_m is not None and nearest.miss_m <= reach_m:
        return nearest.time_s
    closest_s = None if nearest is None else nearest.time_s
    known_s = [s for s in (closest_s, expected_s) if s is not None]
    if settings.horizon_s is None or not known_s or trial.aim is None:
        return trial.alignment.motion_end_s + AFTER_MOTION_S
    if len(known_s) == 2 and abs(known_s[0] - known_s[1]) > SAME_PASS_S:
        return known_s[1] + settings.horizon_s
    return max(known_s) + settings.horizon_s


def _expected_s(trial: Trial) -> float | None:
    """Return the robot time at which the motion was planned to hit."""
    if trial.motion is None or trial.motion.predicted is None:
        return None
    return trial.alignment.motion_start_s + trial.motion.predicted.hit_time_s


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

    return StringBatch(
        np.array([rows[name] for name in PARAMETERS]).T,
        columns("mass", points),
        rows,
        stiff_joints=layout.stiff_joints(),
        free_masses=columns("weight", layout.count),
    )


def thrown_cable(context: Context, arm: Arm) -> tuple[StringModel, CableSpace]:
    """Return the model of a string that is thrown in space, without its clamped length, and its unknowns."""
    length_m = free_length_m(context, arm.clamp.clamped_length_m)
    return cable_of(context, length_m, False, context.settings.string.points or THROWN_POINTS)


def cable_of(
    context: Context, length_m: float, two_ends: bool, points: int, *, pinned: bool = False
) -> tuple[StringModel, CableSpace]:
    """Return the model of the experiment's string in space, of this free length [m], and its unknowns."""
    string, settings = context.settings.string, spatial_settings(context)
    thrown = context.settings.aims_in_space
    return space_of_cable(
        length_m,
        two_ends,
        pinned=pinned,
        points=points,
        step_s=settings.dt_s,
        weight_places_m=[min(weight.place_m, length_m) for weight in string.weights],
        stiff_sections_m=[(section.from_m, min(section.to_m, length_m)) for section in string.stiff_sections],
        ranges=settings.ranges if isinstance(settings.ranges, dict) else None,
        **given_of(settings, in_plane=False, thrown=thrown),
    )


def spatial_settings(context: Context) -> EstimateSettings:
    """Return the settings of the experiment's fits in space."""
    return context.settings.estimate.in_space(thrown=context.settings.aims_in_space)


def string_model(
    context: Context, arm: Arm, weights_m: Sequence[float] | None = None
) -> tuple[StringModel, MassLayout]:
    """Return the model of the experiment's string, without its clamped length, and its mass layout.

    `weights_m` are places of weights [m] from the clamp to use instead of the declared ones.
    """
    if arm.axes == 3:
        model, space = thrown_cable(context, arm)
        return model, space.layout
    string, estimate = context.settings.string, context.settings.estimate
    length_m = free_length_m(context, arm.clamp.clamped_length_m)
    places_m = [weight.place_m for weight in string.weights] if weights_m is None else weights_m
    model = StringModel(length_m, string.n, dt_s=estimate.dt_s)
    layout = mass_layout(
        length_m,
        string.n,
        [min(place_m, length_m) for place_m in places_m],
        [(section.from_m, min(section.to_m, length_m)) for section in string.stiff_sections],
        tip=FREE_END if estimate.free_end else 1.0,
    )
    return model, layout


def servo_of(arm: PlanarArm, trials: list[Trial]) -> Response | None:
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


def _commanded_and_measured(
    arm: PlanarArm, trial: Trial, step_s: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return commanded and measured joints (T, J), from the motion's start until a little after its end."""
    log = trial.log
    assert log is not None
    columns = [log.joint_names.index(name) for name in arm.joints]
    command_rad, q_rad = log.q_cmd_rad[:, columns], log.q_rad[:, columns]
    known = np.isfinite(command_rad).all(axis=1)
    if not known.any():
        return None
    start_s, end_s = trial.alignment.motion_start_s, trial.alignment.motion_end_s + AFTER_MOTION_S
    time_s = start_s + np.arange(round((end_s - start_s) / step_s) + 1) * step_s
    commanded_rad = resampled(time_s, log.time_s[known], command_rad[known])
    return commanded_rad, resampled(time_s, log.time_s, q_rad)
