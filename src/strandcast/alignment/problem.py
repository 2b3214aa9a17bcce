"""What is fitted: clocks and constants of a rig, in units of their priors, to sightings of its markers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.alignment.joints import JointPath
from strandcast.alignment.rig import Misfit, Rig, Seen, marker_poses, marker_slopes, misfit_of

OFFSET_UNIT_S = 1e-3


@dataclass(frozen=True)
class Priors:
    """Standard deviations of what the fit frees beside the offset; 0 holds a value at its nominal one.

    A rig's constant errors look like a time shift while the hand moves one way: free, they cost some
    certainty; held, they would turn up as a wrong offset (1 mm at 2 m/s: 0.5 ms). `known_drift` is the
    drift that the prior is about.
    """

    drift: float = 5e-5
    known_drift: float = 0.0
    base_shift_m: float = 1e-3
    stretch: float = 2e-3
    joint_zero_rad: float = 1e-3
    link_length_m: float = 1e-3
    marker_shift_m: float = 3e-3
    marker_turn_rad: float = 0.02

    def scales(self, rig: Rig) -> np.ndarray:
        """Return the units of offset, drift and `Misfit.vector`: 1 ms, then the standard deviations."""
        joints, markers = len(rig.chain.lengths_m), len(rig.place_m)
        return np.array(
            [
                *[OFFSET_UNIT_S, self.drift],
                *[self.base_shift_m] * 2,
                *[self.stretch] * 3,
                *[self.joint_zero_rad] * joints,
                *[self.link_length_m] * joints,
                *[self.marker_shift_m] * 2 * markers,
                *[self.marker_turn_rad] * markers,
            ]
        )

    def expected(self, rig: Rig) -> np.ndarray:
        """Return what is expected, in these units: the known drift, and a rig as its files say."""
        expected = np.zeros(len(self.scales(rig)))
        expected[1] = self.known_drift / self.drift if self.drift > 0 else 0.0
        return expected


@dataclass(frozen=True)
class Event:
    """An event that both clocks saw, and the standard deviation of the difference of its times [s]."""

    camera_s: float
    robot_s: float
    sigma_s: float


@dataclass(frozen=True, eq=False)
class Problem:
    """What a fit is of: x = (offset, drift, `Misfit.vector`) in units of `scales`, about a start."""

    rig: Rig
    path: JointPath
    seen: Seen
    events: tuple[Event, ...]
    scales: np.ndarray
    expected: np.ndarray
    middle_s: float
    offset_s: float

    def robot_s(self, x: np.ndarray) -> np.ndarray:
        """Return the robot's times of the sightings."""
        shift_s, drift = x[:2] * self.scales[:2]
        return self.middle_s + self.offset_s + shift_s + (1.0 + drift) * (self.seen.time_s - self.middle_s)

    def misfit(self, x: np.ndarray) -> Misfit:
        """Return the rig's constants."""
        return misfit_of((x * self.scales)[2:], self.rig)

    def residual(self, x: np.ndarray) -> np.ndarray:
        """Return seen minus told (m, 3)."""
        told = marker_poses(self.rig, self.path.at(self.robot_s(x)), self.seen.marker, self.misfit(x))
        off = self.seen.pose - told
        off[:, 2] = _wrap(off[:, 2])
        return off

    def slopes(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the slopes of what is told: with the joints (m, 3, J), with x (m, 3, p)."""
        robot_s = self.robot_s(x)
        joint, misfit = marker_slopes(self.rig, self.path.at(robot_s), self.seen.marker, self.misfit(x))
        velocity = np.einsum("mcj,mj->mc", joint, self.path.speed(robot_s))
        since_s = self.seen.time_s - self.middle_s
        clock = np.stack([velocity, velocity * since_s[:, None]], axis=2)
        return joint, np.concatenate([clock, misfit], axis=2) * self.scales

    def event_rows(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the events' residuals (e,) and slopes (e, p), in standard deviations."""
        full = x * self.scales
        off, slope = np.zeros(len(self.events)), np.zeros((len(self.events), len(x)))
        for k, event in enumerate(self.events):
            since_s = event.camera_s - self.middle_s
            told_s = self.middle_s + self.offset_s + full[0] + (1.0 + full[1]) * since_s
            off[k] = (event.robot_s - told_s) / event.sigma_s
            slope[k, :2] = np.array([1.0, since_s]) * self.scales[:2] / event.sigma_s
        return off, slope

    def prior(self, wider: float = 1.0) -> np.ndarray:
        """Return the priors' information (p,): none on the offset; what is held is held."""
        information = np.where(self.scales > 0, 1.0, 1e12)
        information[2:] /= wider**2
        information[0] = 0.0
        return information


def _wrap(angle_rad: np.ndarray) -> np.ndarray:
    return np.asarray((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
