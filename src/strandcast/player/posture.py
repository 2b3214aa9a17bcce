"""The moving joints among all joints of a controller."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.arm.load import Arm
from strandcast.errors import StrandcastError


@dataclass(frozen=True, eq=False)
class Posture:
    """Puts the moving joints where the controller has them, and holds the others.

    Attributes
    ----------
    names
        All N joints, in the controller's order.
    places
        (J,) where the moving joints stand among them.
    held_rad
        (N,) the held joints' angles [rad], zero for those that move.
    """

    names: tuple[str, ...]
    places: np.ndarray
    held_rad: np.ndarray

    @classmethod
    def of(cls, arm: Arm, names: tuple[str, ...] | list[str]) -> Posture:
        """Return it for an arm whose controller has the joints `names`, called as in the URDF.

        Raises
        ------
        StrandcastError
            SC-X031 a joint of the arm's file is not the controller's, or the other way round.
        """
        known = set(arm.joints) | set(arm.held)
        if known != set(names):
            raise StrandcastError(
                "SC-X031", f"the controller's joints are {', '.join(names)}", file=arm.path,
                field="throw.joints, throw.held", cost="nothing was sent to the arm",
                fix=f"name exactly these (differing: {', '.join(sorted(known ^ set(names)))})")  # fmt: skip
        held = np.array([arm.held.get(name, 0.0) for name in names])
        return cls(tuple(names), np.array([list(names).index(name) for name in arm.joints]), held)

    def whole(self, q: np.ndarray) -> np.ndarray:
        """Return (N,) angles from (J,) of the moving joints, the others held."""
        answer = self.held_rad.copy()
        answer[self.places] = q
        return answer

    def speeds(self, qd: np.ndarray) -> np.ndarray:
        """Return (N,) speeds from (J,) of the moving joints, the others still."""
        answer = np.zeros(len(self.names))
        answer[self.places] = qd
        return answer

    def moving(self, values: np.ndarray) -> np.ndarray:
        """Return (J,) of the moving joints from (N,) of all."""
        return np.asarray(values, float)[self.places]

    def held(self, values: np.ndarray) -> dict[str, float]:
        """Return the values of the held joints, by name, from (N,) of all."""
        moving = {int(place) for place in self.places}
        return {name: float(values[k]) for k, name in enumerate(self.names) if k not in moving}
