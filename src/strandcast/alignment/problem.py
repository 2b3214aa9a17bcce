"""The least-squares problem of the alignment: clocks and rig errors, in units of their priors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strandcast.alignment.joints import JointPath
from strandcast.config.align import DRIFT_SD
from strandcast.core.pose import wrapped
from strandcast.rig.model import Detections, Rig, RigError, RigPriors, marker_jacobian, marker_poses

OFFSET_UNIT_S = 1e-3


@dataclass(frozen=True)
class Priors(RigPriors):
    """Standard deviations of the fit's unknowns besides the offset; 0 fixes a value at its nominal one.

    `drift` is that of the clocks' relative drift, `known_drift` the mean of its prior.
    """

    known_drift: float = 0.0
    drift: float = DRIFT_SD

    def scales(self, rig: Rig) -> np.ndarray:
        """Return the units of offset, drift and `RigError.vector`: 1 ms, then the standard deviations."""
        return np.array([OFFSET_UNIT_S, self.drift, *self.of(rig)])

    def expected(self, rig: Rig) -> np.ndarray:
        """Return the priors' mean in these units: the known drift, and a rig as its files say."""
        expected = np.zeros(len(self.scales(rig)))
        expected[1] = self.known_drift / self.drift if self.drift > 0 else 0.0
        return expected


@dataclass(frozen=True)
class EventPair:
    """An event on both clocks, and the standard deviation of the difference of its times [s]."""

    camera_s: float
    robot_s: float
    sigma_s: float


@dataclass(frozen=True, eq=False)
class ClockProblem:
    """The residuals that a fit minimises, by x = (offset, drift, `RigError.vector`) in units of `scales`.

    Attributes
    ----------
    rig, path, detections, events
        The arm and its markers, the joints over all the time of the detections, the detected markers in order
        of time, the events on both clocks.
    scales, expected
        (p,) units of x, and the priors' mean in these units.
    middle_s
        Mean camera time of the detections, about which the clocks are fitted.
    offset_s
        Start of the fit, near the solution; x counts from it.
    """

    rig: Rig
    path: JointPath
    detections: Detections
    events: tuple[EventPair, ...]
    scales: np.ndarray
    expected: np.ndarray
    middle_s: float
    offset_s: float

    @classmethod
    def of(
        cls,
        rig: Rig,
        path: JointPath,
        detections: Detections,
        offset_s: float,
        priors: Priors,
        events: tuple[EventPair, ...] = (),
    ) -> ClockProblem:
        """Return the problem of a fit that starts at `offset_s`."""
        scales, expected = priors.scales(rig), priors.expected(rig)
        middle_s = float(detections.time_s.mean())
        return cls(rig, path, detections, events, scales, expected, middle_s, offset_s)

    def with_priors(self, priors: Priors) -> ClockProblem:
        """Return the same problem with other priors."""
        return replace(self, scales=priors.scales(self.rig), expected=priors.expected(self.rig))

    def robot_s(self, x: np.ndarray) -> np.ndarray:
        """Return the robot times (m,) of the detections."""
        shift_s, drift = x[:2] * self.scales[:2]
        since_s = self.detections.time_s - self.middle_s
        return np.asarray(self.middle_s + self.offset_s + shift_s + (1.0 + drift) * since_s)

    def rig_error(self, x: np.ndarray) -> RigError:
        """Return the rig's constant errors."""
        return RigError.from_vector((x * self.scales)[2:], self.rig)

    def residual(self, x: np.ndarray) -> np.ndarray:
        """Return measured minus predicted marker poses (m, 3) [m, m, rad]."""
        q_rad = self.path.at(self.robot_s(x))
        predicted = marker_poses(self.rig, q_rad, self.detections.marker, self.rig_error(x))
        off = self.detections.pose.array() - predicted.array()
        off[:, 2] = wrapped(off[:, 2])
        return np.asarray(off)

    def jacobian(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of the predicted poses: by the joints (m, 3, J), by x (m, 3, p)."""
        robot_s = self.robot_s(x)
        joint, error = marker_jacobian(
            self.rig, self.path.at(robot_s), self.detections.marker, self.rig_error(x)
        )
        velocity = np.einsum("mcj,mj->mc", joint, self.path.speed(robot_s))
        since_s = self.detections.time_s - self.middle_s
        clock = np.stack([velocity, velocity * since_s[:, None]], axis=2)
        return joint, np.concatenate([clock, error], axis=2) * self.scales

    def event_residual(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the events' residuals (e,) and derivatives (e, p), in standard deviations."""
        full = x * self.scales
        off, slope = np.zeros(len(self.events)), np.zeros((len(self.events), len(x)))
        for k, event in enumerate(self.events):
            since_s = event.camera_s - self.middle_s
            predicted_s = self.middle_s + self.offset_s + full[0] + (1.0 + full[1]) * since_s
            off[k] = (event.robot_s - predicted_s) / event.sigma_s
            slope[k, :2] = np.array([1.0, since_s]) * self.scales[:2] / event.sigma_s
        return off, slope

    def prior(self, wider: float = 1.0) -> np.ndarray:
        """Return the priors' information (p,), none on the offset; `wider` scales the rig's priors."""
        information = np.where(self.scales > 0, 1.0, 1e12)
        information[2:] /= wider**2
        information[0] = 0.0
        return information
