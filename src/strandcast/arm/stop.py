"""How an arm comes to rest: the soft stop (ruckig, velocity mode), and a bound of it, fast."""

import numpy as np
import ruckig

from strandcast.arm.joint_limits import Stop


class SoftStop:
    """Bring each joint to rest as fast as its limits allow, independently of the others.

    Parameters
    ----------
    acceleration_rad_s2, jerk_rad_s3
        (J,) limits, finite.
    """

    def __init__(self, acceleration_rad_s2: np.ndarray, jerk_rad_s3: np.ndarray) -> None:
        count = len(acceleration_rad_s2)
        self._limit = np.asarray(acceleration_rad_s2, float)
        self._generator = ruckig.Ruckig(count)
        self._trajectory = ruckig.Trajectory(count)
        self._input = ruckig.InputParameter(count)
        self._input.control_interface = ruckig.ControlInterface.Velocity
        self._input.synchronization = ruckig.Synchronization.No
        self._input.max_acceleration = self._limit.tolist()
        self._input.max_jerk = list(map(float, jerk_rad_s3))
        self._input.target_velocity = [0.0] * count
        self._input.target_acceleration = [0.0] * count

    def begin(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> float:
        """Plan the stop from (J,) angles, speeds and accelerations; return its duration [s]."""
        self._input.current_position = q.tolist()
        self._input.current_velocity = qd.tolist()
        self._input.current_acceleration = np.clip(qdd, -self._limit, self._limit).tolist()
        result = self._generator.calculate(self._input, self._trajectory)
        if result not in (ruckig.Result.Working, ruckig.Result.Finished):
            raise ValueError(f"no stop from {q}, {qd}, {qdd}: {result}")
        return float(self._trajectory.duration)

    def at(self, since_s: float) -> tuple[list[float], list[float], list[float]]:
        """Return (J,) angles, speeds and accelerations of the stop, `since_s` after it began."""
        q, qd, qdd = self._trajectory.at_time(since_s)
        return q, qd, qdd

    def resting_place(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Return the angles at which the arm would come to rest: (T, J) from (T, J) each."""
        return np.array([self.at(self.begin(*row) + 1.0)[0] for row in zip(q, qd, qdd, strict=True)])


def turned_in_stop(
    stop: Stop, full_rad_s: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return how far each joint turns until it rests [rad], and how long that takes [s]; (..., J) each.

    The further and the longer of two stops: the soft stop, and the controller's own, if the arm's file gives
    its angle at full speed (it grows with the square of the speed; assuming proportionality is conservative;
    its time grows with the speed).

    Parameters
    ----------
    full_rad_s
        (J,) full speed.
    qd, qdd
        (..., J) speeds [rad/s] and accelerations [rad/s²] when the stop begins.
    """
    brake, jerk = stop.acceleration_rad_s2, stop.jerk_rad_s3
    # First the acceleration of a joint is removed, then the joint brakes.
    direction = np.sign(np.where(qd == 0.0, qdd, qd))
    pushed = np.minimum(np.maximum(qdd * direction, 0.0), brake)
    speed = np.abs(qd) + pushed**2 / (2.0 * jerk)
    soft = np.abs(qd) * pushed / jerk + pushed**3 / (3.0 * jerk**2)
    soft += speed**2 / (2.0 * brake) + speed * brake / (2.0 * jerk)
    soft_s = np.where(speed > brake**2 / jerk, speed / brake + brake / jerk, 2.0 * np.sqrt(speed / jerk))
    share = np.abs(qd) / full_rad_s
    further = np.maximum(soft, stop.distance_rad * share)
    return direction * further, np.maximum(pushed / jerk + soft_s, stop.time_s * share)
