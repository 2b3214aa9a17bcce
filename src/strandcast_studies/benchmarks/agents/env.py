"""Throw an unknown string at a target in the virtual lab, as a Gymnasium environment.

One step is one throw, one episode up to `throws` throws of one string. See docs/benchmark.md.
"""

from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces

from strandcast.arm.load import PlanarArm
from strandcast.config.lab import LabSettings
from strandcast.core.closest_approach import closest_approach
from strandcast.core.trajectory import JointTrajectory
from strandcast.lab.driver import joint_log
from strandcast.lab.strings import physical_string
from strandcast.lab.swing import BEFORE_S, LabSwing, simulate_swing
from strandcast.lab.tracked_points import TrackerNoise, points_at, with_tracker_noise
from strandcast.lab.truth import MISS_AFTER_S, true_miss
from strandcast.lab.variation import LabClocks, ThrowVariation, draw_variation, scatter_of
from strandcast.planning.cost import start_violation_m
from strandcast.seeds import rng
from strandcast_studies.benchmarks.agents.actions import KINDS, LONGEST_S, RATE_HZ, within_limits
from strandcast_studies.benchmarks.agents.tasks import arm_of, task_of
from strandcast_studies.benchmarks.loop.throw import FRAME_RATE_HZ

POINTS = 10  # tracked points of the string, without the hand
FRAMES = round((LONGEST_S + MISS_AFTER_S) * RATE_HZ) + 1
UNSEEN_M = 1.0  # each component of `closest_m` where the closest approach was not tracked
REFUSED_M = 1.0  # counts as the miss of a motion that is refused
FAR_M, TURNS_RAD, MOST_THROWS = 3.0, 10.0, 10_000.0  # bounds of the observation

Observation = dict[str, np.ndarray]


class ThrowEnv(gymnasium.Env):
    """Hit a target with the tip of a string with unknown properties.

    Parameters
    ----------
    string
        1 to 7: one of the paper's strings at its own target, with a new scatter in every episode; 0: every
        episode has a random string, servo and target.
    action
        ``curve`` or ``velocities``; see `strandcast_studies.benchmarks.agents.actions`.
    throws
        Largest number of throws in an episode.
    stop_at_hit
        Whether the first hit ends the episode.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(
        self, string: int = 0, action: str = "curve", throws: int = 5, stop_at_hit: bool = True
    ) -> None:
        self._string, self._kind, self._throws, self._stop_at_hit = string, KINDS[action], throws, stop_at_hit
        self._task = task_of(string, 0)
        self._throw = 0
        joints = len(self._arm.joints)
        self.action_space = spaces.Box(-1.0, 1.0, self._kind.shape(self._arm), np.float32)
        bounds: dict[str, tuple[float, float, tuple[int, ...]]] = {
            "target_m": (-FAR_M, FAR_M, (2,)),
            "string_m": (0.0, FAR_M, (5,)),
            "throw": (0.0, MOST_THROWS, (1,)),
            "closest_m": (-FAR_M, FAR_M, (2,)),
            "points_m": (-FAR_M, FAR_M, (FRAMES, POINTS + 1, 2)),
            "seen": (0.0, 1.0, (FRAMES, POINTS + 1)),
            "joints_rad": (-TURNS_RAD, TURNS_RAD, (FRAMES, joints)),
            "action": (-1.0, 1.0, self.action_space.shape),
        }
        self.observation_space = spaces.Dict(
            {name: spaces.Box(low, high, shape, np.float32) for name, (low, high, shape) in bounds.items()}
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin with a new string; ``options={"task": Task(…)}`` chooses it.

        The same seed gives the same string and the same scatter of every throw.
        """
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(2**31)) if seed is None else seed
        self._task = (options or {}).get("task") or task_of(self._string, drawn)
        self._throw = 0
        return self._observation(np.zeros(self.action_space.shape)), {}

    def step(self, action: np.ndarray) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Throw once; the reward is minus the true miss [m].

        `info`: ``miss_m``, ``hit``, ``refused``, and ``share``, the least share of a joint's motion that the
        arm's limits left.
        """
        self._throw += 1
        action = np.clip(action, -1.0, 1.0)
        played = self._played(action)
        observation, miss_m, share = self._observation(action), REFUSED_M, 0.0
        if played is not None:
            motion, share = played
            scatter = scatter_of(self._task.name, self._task.experiment.seed, self._lab)
            given = len(self._arm.joints), 1.0, scatter
            variation = draw_variation(self._random("lab-throw"), *given)
            string = physical_string(self._task.experiment).clamped(self._arm.clamp.clamped_length_m)
            swing = simulate_swing(self._arm, self._lab.servo, string, variation, motion)
            miss_m = true_miss(swing, self._target_m, motion.end_s)[0]
            self._watch(observation, swing, variation, motion.end_s)
        hit = miss_m <= self._task.experiment.hit_radius_m
        info = {"miss_m": miss_m, "hit": hit, "refused": played is None, "share": share}
        done = self._throw >= self._throws or (hit and self._stop_at_hit)
        return observation, -miss_m, done, False, info

    def preflight(self, action: np.ndarray) -> bool:
        """Whether the arm plays an action: known before the throw, as it depends on the arm alone."""
        return self._played(np.clip(action, -1.0, 1.0)) is not None

    def _played(self, action: np.ndarray) -> tuple[JointTrajectory, float] | None:
        """Return the motion within the limits; None if the string would hang over the arm, or unseen."""
        found = within_limits(self._arm, self._kind.asked(self._arm, action))
        if found is None:
            return None
        experiment, start = self._task.experiment, found[0].q_rad[:1]
        box = self._box()
        deep_m = start_violation_m(self._arm, experiment.string.length_m, box, start)
        return found if deep_m[0] == 0.0 else None

    def _observation(self, action: np.ndarray) -> Observation:
        """Return what is known before a throw is seen."""
        known, shapes = self._task.experiment.string, self.observation_space
        observation: Observation = {name: np.zeros(shapes[name].shape, np.float32) for name in shapes}
        places = [weight.place_m for weight in known.weights]
        stiff = [end for section in known.stiff_sections for end in (section.from_m, section.to_m)]
        observation["target_m"][:] = self._target_m
        observation["string_m"][0] = known.length_m
        observation["string_m"][1 : 1 + len(places)] = places
        observation["string_m"][3 : 3 + len(stiff)] = stiff
        observation["throw"][:] = self._throw
        observation["closest_m"][:] = UNSEEN_M
        observation["action"][:] = action
        return observation

    def _watch(
        self, observation: Observation, swing: LabSwing, variation: ThrowVariation, motion_s: float
    ) -> None:
        """Add what camera and joint log show of a throw, with their noise."""
        noise, random = TrackerNoise(), self._random("lab-sensor")
        time_s = np.arange(round((motion_s + MISS_AFTER_S) * FRAME_RATE_HZ) + 1) / FRAME_RATE_HZ
        places_m = np.linspace(0.0, swing.places_m[-1], POINTS + 1)
        late_s = noise.offset_s * random.standard_normal()
        points_m = points_at(swing, places_m, time_s + late_s)
        points_m = with_tracker_noise(points_m, 1.0 / FRAME_RATE_HZ, noise, random)
        box = self._box()
        points_m[((points_m < box[:, 0]) | (points_m > box[:, 1])).any(axis=2)] = np.nan  # out of the picture
        closest_m = _closest_m(time_s, points_m[:, -1], self._target_m)
        if closest_m is not None:
            observation["closest_m"][:] = closest_m
        rows = slice(None, None, round(FRAME_RATE_HZ / RATE_HZ))
        shown = points_m[rows]
        seen = np.isfinite(shown).all(axis=2)
        observation["points_m"][: len(shown)] = np.where(seen[:, :, None], shown, 0.0)
        observation["seen"][: len(shown)] = seen
        log = joint_log(
            self._arm, swing, variation, LabClocks(-BEFORE_S, 0.0, 0.0), motion_s, self._random("lab-log")
        )
        for joint, angles in enumerate(log.q_rad.T):
            observation["joints_rad"][: len(shown), joint] = np.interp(time_s[rows], log.time_s, angles)

    def _random(self, of: str) -> np.random.Generator:
        return rng(self._task.name, self._task.experiment.seed, self._throw, of)

    def _box(self) -> np.ndarray:
        """Return the camera's view as (2, 2): low and high of x and y [m]."""
        own = self._task.experiment.workspace_m
        return self._arm.box_m if own is None else np.array([own.x_m, own.y_m])

    @property
    def _arm(self) -> PlanarArm:
        return arm_of(self._task.experiment.arm)

    @property
    def _lab(self) -> LabSettings:
        lab = self._task.experiment.lab
        assert lab is not None
        return lab

    @property
    def _target_m(self) -> np.ndarray:
        return np.array(self._task.experiment.target_m)


def _closest_m(time_s: np.ndarray, tip_m: np.ndarray, target_m: np.ndarray) -> np.ndarray | None:
    """Return the vector from the tracked tip's closest approach to the target; None if it was not tracked."""
    seen = np.isfinite(tip_m).all(axis=1)
    if seen.sum() < 2:
        return None
    window_s = float(time_s[0]), float(time_s[-1])
    found, _ = closest_approach(time_s[seen], tip_m[seen], target_m, 1.0 / FRAME_RATE_HZ, window_s)
    return None if found is None else target_m - found.place_m
