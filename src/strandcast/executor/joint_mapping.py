"""Map the moving joints to the joints of a controller and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.arm.load import Arm
from strandcast.errors import StrandcastError
from strandcast.executor.locks import NOTHING_SENT


@dataclass(frozen=True, eq=False)
class ControllerJoints:
    """The joints of a controller: which of them move, and where the others are held.

    Attributes
    ----------
    names
        All N joints, in the controller's order.
    moving_index
        (J,) indices of the moving joints among them.
    held_rad
        (N,) angles of the held joints [rad]; zero for those that move.
    """

    names: tuple[str, ...]
    moving_index: np.ndarray
    held_rad: np.ndarray

    @classmethod
    def of(cls, arm: Arm, names: tuple[str, ...] | list[str]) -> ControllerJoints:
        """Return the mapping for a controller with the joints `names`, named as in the URDF.

        SC-F205: a joint of the arm's file is not the controller's, or the reverse.
        """
        known = set(arm.joints) | set(arm.held)
        if known != set(names):
            raise StrandcastError(
                "SC-F205",
                f"the controller's joints are {', '.join(names)}",
                file=arm.path,
                field="throw.joints, throw.held",
                cost=NOTHING_SENT,
                fix=f"name exactly these (differing: {', '.join(sorted(known ^ set(names)))})",
            )
        held = np.array([arm.held.get(name, 0.0) for name in names])
        return cls(tuple(names), np.array([list(names).index(name) for name in arm.joints]), held)

    def all_angles(self, q: np.ndarray) -> np.ndarray:
        """Return (..., N) angles of all joints from (..., J) of the moving ones."""
        return self._among(self.held_rad, q)

    def all_rates(self, qd: np.ndarray) -> np.ndarray:
        """Return (..., N) speeds or accelerations of all joints from (..., J) of the moving ones."""
        return self._among(np.zeros(len(self.names)), qd)

    def _among(self, resting: np.ndarray, values: np.ndarray) -> np.ndarray:
        found = np.broadcast_to(resting, (*np.shape(values)[:-1], len(resting))).copy()
        found[..., self.moving_index] = values
        return found

    def moving(self, values: np.ndarray) -> np.ndarray:
        """Return (J,) values of the moving joints from (N,) of all."""
        return np.asarray(np.asarray(values, float)[self.moving_index])

    def held(self, values: np.ndarray) -> dict[str, float]:
        """Return the held joints' values by name, from (N,) of all."""
        moving = {int(k) for k in self.moving_index}
        return {name: float(values[k]) for k, name in enumerate(self.names) if k not in moving}
