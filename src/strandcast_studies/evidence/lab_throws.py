"""Strings thrown in the lab with several motions and tracked with noise, as input for the estimation."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import savgol_filter

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import PlanarArm, load_arm
from strandcast.config.plan import PlanSettings
from strandcast.core.box import Box
from strandcast.core.strings import StringBatch
from strandcast.core.trajectory import JointTrajectory
from strandcast.dynamics.batch import HANGING_AT_REST, HandPath
from strandcast.dynamics.masses import MassLayout, mass_layout, point_masses, points_touched
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import Array, ensemble
from strandcast.estimation.fit_objective import simulate_throw
from strandcast.estimation.measured import Throw, prepare
from strandcast.lab.strings import PhysicalString
from strandcast.lab.swing import simulate_swing
from strandcast.lab.tracked_points import points_at
from strandcast.lab.variation import draw_variation
from strandcast.planning.bezier import sample
from strandcast.planning.global_search import screen
from strandcast.planning.rollouts import RolloutConditions
from strandcast.planning.search import SearchInputs
from strandcast.planning.task import PlanningTask

ARM_FILE = Path(__file__).resolve().parents[3] / "config" / "arms" / "planar3.toml"
SPACING_M = 0.03
WORKSPACE = Box(x_m=(-0.75, 1.25), y_m=(-0.32, 0.80))
SCREENED = 64  # random motions; the one that comes nearest to the target is thrown
FRAME_RATE_HZ = 500.0
TRACKED_M = 0.0007  # standard deviation of a tracked coordinate
LOGGED_RAD = 0.0005  # of a logged joint angle
SMOOTHED = 9  # samples of the joint log's smoothing window
BEFORE_S, AFTER_S = 0.15, 0.03


@dataclass(frozen=True, eq=False)
class Specimen:
    """One string and its throws."""

    thread: PhysicalString  # the true string
    model: StringModel  # of the estimation
    layout: MassLayout  # of the estimation
    throws: list[Throw]  # measurements, one per motion

    @property
    def plain_kg(self) -> float:
        """Mass of string represented by one plain point: the unit of relative masses [kg]."""
        return self.thread.linear_density_kg_m * self.model.spacing_m

    def true_weights(self) -> Array:
        """Return the relative masses (w,) of the weights."""
        return np.array([mass_kg / self.plain_kg for _, mass_kg in self.thread.weights])

    def true_pipe(self) -> float:
        """Return the relative mass of all pipes together."""
        return sum(mass_kg for _, _, mass_kg in self.thread.pipes) / self.plain_kg


def light(thread: PhysicalString, pipe_kg: float) -> PhysicalString:
    """Return the string with pipes of another mass and the same stiffness."""
    return replace(thread, pipes=tuple((start, end, pipe_kg) for start, end, _ in thread.pipes))


def limp(thread: PhysicalString, n: int) -> PhysicalString:
    """Return the string with beads of the same mass instead of pipes, at the points that these touched."""
    beads = list(thread.weights)
    for start, end, mass_kg in thread.pipes:
        points = points_touched(start, end, thread.length_m / n, n)
        beads += [(thread.length_m * point / n, mass_kg / len(points)) for point in points]
    return replace(thread, weights=tuple(sorted(beads)), pipes=())


def specimen(
    thread: PhysicalString,
    targets_m: list[tuple[float, float]],
    rng: np.random.Generator,
    scatter: float = 1.0,
    *,
    stiff: bool = True,
) -> Specimen:
    """Throw a string at several targets.

    Parameters
    ----------
    thread
        The string.
    targets_m
        (x, y) each; the motion is the best of several random ones for a similar string.
    rng
        Random generator; the motions do not depend on the mass of the pipes.
    scatter
        Throw-to-throw variation (grasp, sway, encoders), 1 for a typical rig; noise of camera and joint log
        is always added.
    stiff
        Whether the pipes are stiff; if not, `limp` beads of the same mass replace them.
    """
    arm = load_arm(ARM_FILE).planar()
    motions_rng, throws_rng = rng.spawn(2)
    n = round(thread.length_m / SPACING_M)
    layout = mass_layout(
        thread.length_m, n, [place for place, _ in thread.weights], [(a, b) for a, b, _ in thread.pipes]
    )
    model = StringModel(thread.length_m, n)
    draw = ensemble(2, thread.length_m, n, len(thread.weights), motions_rng, layout.stiff)
    candidates = StringBatch(draw.parameters, point_masses(layout, draw.weight_masses))
    thrown, throws = thread if stiff else limp(thread, n), []
    for target_m in targets_m:
        task = PlanningTask(arm, model, np.array(target_m), 0.02, WORKSPACE)
        settings = PlanSettings(evaluations=SCREENED)
        given = SearchInputs(task, candidates, RolloutConditions(), settings, motions_rng)
        curve = screen(given, 1)[0][0]
        throws.append(
            _thrown(arm, thrown, sample(curve, task.step_s), model, task.target_m, throws_rng, scatter)
        )
    return Specimen(thread, model, layout, throws)


def _thrown(
    arm: PlanarArm,
    thread: PhysicalString,
    motion: JointTrajectory,
    model: StringModel,
    target_m: Array,
    rng: np.random.Generator,
    scatter: float,
) -> Throw:
    variation = draw_variation(rng, len(arm.joints), scatter)
    swing = simulate_swing(arm, "servoj", thread, variation, motion)
    every = round(1.0 / (arm.log_rate_hz * (swing.time_s[1] - swing.time_s[0])))
    log_s, q = swing.time_s[::every], swing.q_rad[::every] - variation.joint_zero_rad
    q = savgol_filter(q + LOGGED_RAD * rng.standard_normal(q.shape), SMOOTHED, 2, axis=0)
    time_s = np.arange(-BEFORE_S, log_s[-1], 1.0 / FRAME_RATE_HZ)
    points = points_at(swing, model.places_m(), time_s)
    # As in the stage, E ends shortly after the closest approach: frames after a touch do not count.
    away_m = np.hypot(*(points[:, -1] - target_m).T)
    counted = (time_s > 0.45 * motion.time_s[-1]) & (time_s < motion.time_s[-1] + 0.3)
    until_s = time_s[counted][np.argmin(away_m[counted])] + AFTER_S
    tracked = points + TRACKED_M * rng.standard_normal(points.shape)
    return Throw(time_s, tracked, log_s, hand_pose(arm.chain, arm.clamp, q).array(), time_s <= until_s)


def rethrown(one: Specimen, strings: StringBatch, rng: np.random.Generator) -> Specimen:
    """Return the same throws simulated by the model itself with `strings` (a batch of one).

    The string hangs at rest until the hand moves; the noise is the same.
    """
    throws = []
    for throw in one.throws:
        task = replace(
            prepare(throw, one.model.places_m()),
            frames=np.arange(len(throw.time_s)),
            time_s=throw.time_s,
            hand=HandPath(throw.hand_time_s, throw.hand_pose),
            start=HANGING_AT_REST,
        )
        points = simulate_throw(one.model, task, strings)[0][0]
        throws.append(replace(throw, points_m=points + TRACKED_M * rng.standard_normal(points.shape)))
    return replace(one, throws=throws)
