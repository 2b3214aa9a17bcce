"""Strings of the lab, thrown in several ways and seen through noise, as the estimation gets them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import savgol_filter

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import Arm, Box, load_arm
from strandcast.estimation.objective import play
from strandcast.estimation.space import Strings
from strandcast.estimation.throw import Throw, prepare
from strandcast.lab.capture import points_at
from strandcast.lab.strings import Thread
from strandcast.lab.swing import simulate_swing
from strandcast.lab.variation import draw_variation
from strandcast.motion.bezier import Samples, sample
from strandcast.motion.first import screen
from strandcast.motion.strings import Strings as Candidates
from strandcast.motion.task import Options, Task
from strandcast.motion.throws import World
from strandcast.player.protocol import Command
from strandcast.string.masses import MassLayout, mass_layout, point_masses, points_touched
from strandcast.string.model import StringModel
from strandcast.string.parameters import Array, ensemble

ARM_FILE = Path(__file__).resolve().parents[3] / "config" / "arms" / "planar3.toml"
SPACING_M = 0.03
WORKSPACE = Box((-0.75, 1.25), (-0.32, 0.80))
SCREENED = 64  # random motions, of which the one that comes nearest to the target is thrown
FRAME_RATE_HZ = 500.0
SEEN_M = 0.0007  # standard deviation of a tracked coordinate
LOGGED_RAD = 0.0005  # of a logged joint angle
SMOOTHED = 9  # samples of the joint log
BEFORE_S, AFTER_S = 0.15, 0.03


@dataclass(frozen=True, eq=False)
class Specimen:
    """One string and its throws.

    Attributes
    ----------
    thread
        The string as it is.
    model, layout
        As the estimation models it.
    throws
        One per motion, as measured.
    """

    thread: Thread
    model: StringModel
    layout: MassLayout
    throws: list[Throw]

    @property
    def plain_kg(self) -> float:
        """Mass of the string that one plain point stands for: the unit of relative masses [kg]."""
        return self.thread.linear_density_kg_m * self.model.spacing_m

    def true_weights(self) -> Array:
        """(w,) relative masses of the weights."""
        return np.array([mass_kg / self.plain_kg for _, mass_kg in self.thread.weights])

    def true_pipe(self) -> float:
        """Relative mass of all pipes together."""
        return sum(mass_kg for _, _, mass_kg in self.thread.pipes) / self.plain_kg


def light(thread: Thread, pipe_kg: float) -> Thread:
    """Return the string with pipes of another mass, as stiff as before."""
    return replace(thread, pipes=tuple((start, end, pipe_kg) for start, end, _ in thread.pipes))


def limp(thread: Thread, n: int) -> Thread:
    """Return the string without pipes, their masses in beads at the points that they touched."""
    beads = list(thread.weights)
    for start, end, mass_kg in thread.pipes:
        points = points_touched(start, end, thread.length_m / n, n)
        beads += [(thread.length_m * point / n, mass_kg / len(points)) for point in points]
    return replace(thread, weights=tuple(sorted(beads)), pipes=())


def specimen(
    thread: Thread,
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
        (x, y) each; the motion is the best of a few random ones, for a string like this one.
    rng
        Source of chance; its first draw fixes the motions, whatever the thread's pipes weigh.
    scatter
        What differs from throw to throw (grasp, sway, encoders), in units of a usual rig; the noise of
        camera and joint log is there with 0, too.
    stiff
        Whether its pipes are stiff; if not, `limp` beads of the same mass are thrown in their place.
    """
    arm = load_arm(ARM_FILE)
    motions_rng, throws_rng = rng.spawn(2)
    n = round(thread.length_m / SPACING_M)
    layout = mass_layout(
        thread.length_m, n, [place for place, _ in thread.weights], [(a, b) for a, b, _ in thread.pipes]
    )
    model = StringModel(thread.length_m, n)
    draw = ensemble(2, thread.length_m, n, len(thread.weights), motions_rng, layout.stiff)
    candidates = Candidates(draw.parameters, point_masses(layout, draw.weight_masses))
    thrown, throws = thread if stiff else limp(thread, n), []
    for target_m in targets_m:
        task = Task(arm, model, np.array(target_m), 0.02, WORKSPACE)
        options = Options(screening=SCREENED, members=len(candidates))
        curve = screen(task, candidates, World(), options, motions_rng)[0]
        throws.append(
            _thrown(arm, thrown, sample(curve, task.step_s), model, task.target_m, throws_rng, scatter)
        )
    return Specimen(thread, model, layout, throws)


def _thrown(
    arm: Arm,
    thread: Thread,
    motion: Samples,
    model: StringModel,
    target_m: Array,
    rng: np.random.Generator,
    scatter: float,
) -> Throw:
    variation = draw_variation(rng, len(arm.joints), scatter)
    command = Command(motion.time_s, motion.q, motion.qd, motion.qdd)
    swing = simulate_swing(arm, "servoj", thread, variation, command)
    every = round(1.0 / (arm.log_rate_hz * (swing.time_s[1] - swing.time_s[0])))
    log_s, q = swing.time_s[::every], swing.q_rad[::every] - variation.joint_zero_rad
    q = savgol_filter(q + LOGGED_RAD * rng.standard_normal(q.shape), SMOOTHED, 2, axis=0)
    time_s = np.arange(-BEFORE_S, log_s[-1], 1.0 / FRAME_RATE_HZ)
    points = points_at(swing, model.places_m(), time_s)
    # E ends shortly after the closest approach, as the stage has it: what comes after a touch is no throw.
    away_m = np.hypot(*(points[:, -1] - target_m).T)
    counted = (time_s > 0.45 * motion.time_s[-1]) & (time_s < motion.time_s[-1] + 0.3)
    until_s = time_s[counted][np.argmin(away_m[counted])] + AFTER_S
    seen = points + SEEN_M * rng.standard_normal(points.shape)
    return Throw(time_s, seen, log_s, hand_pose(arm.chain, arm.clamp, q), time_s <= until_s)


def rethrown(one: Specimen, strings: Strings, rng: np.random.Generator) -> Specimen:
    """Return the same throws as the model itself would have made them with `strings` (a batch of one).

    The string hangs at rest until the hand moves, and is seen through the same noise.
    """
    throws = []
    for throw in one.throws:
        task = replace(
            prepare(throw, one.model.places_m()),
            frames=np.arange(len(throw.time_s)),
            time_s=throw.time_s,
            hand_time_s=throw.hand_time_s,
            hand_pose=throw.hand_pose,
            start_m=None,
            start_velocity_m_s=None,
        )
        points = play(one.model, task, strings)[0][0]
        throws.append(replace(throw, points_m=points + SEEN_M * rng.standard_normal(points.shape)))
    return replace(one, throws=throws)
