"""The seam between the streaming loop and a driver: a link to a controller, and the states it returns."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np


@dataclass(slots=True)
class ControllerState:
    """The newest state reported by the controller; a link may update one object in place.

    Attributes
    ----------
    time_s
        The controller's own clock [s].
    q_rad, qd_rad_s
        (J,) measured.
    fault
        Why the controller stops or has stopped the arm (protective stop, reflex, emergency stop), or None.
    speed_scaling
        1.0 is full speed.
    sync_high
        The sync output, read back in the same packet.
    """

    time_s: float
    q_rad: np.ndarray
    qd_rad_s: np.ndarray
    fault: str | None = None
    speed_scaling: float = 1.0
    sync_high: bool = False


class ControllerStopped(Exception):
    """The controller has ended the motion; the text is the reason."""


class StreamLink(Protocol):
    """An open connection to a controller that accepts set points.

    Attributes
    ----------
    paces
        Whether `read` waits for the controller's next cycle; if not, the host's deadlines set the pace.
    """

    paces: bool

    def start(self) -> None:
        """Start the vendor's streaming; the first `read` follows at once."""

    def read(self) -> ControllerState:
        """Return the controller's newest state; ControllerStopped if it has ended the motion.

        It must not block; if it paces, it must time out. After ControllerStopped it still returns states for
        the log's tail, as long as there are any.
        """

    def write(self, q_rad: np.ndarray, qd_rad_s: np.ndarray) -> None:
        """Send one set point, (J,) angles and speeds; ControllerStopped if it is no longer accepted."""

    def finish(self) -> None:
        """End the vendor's streaming, with the sync output low.

        Called exactly once, at rest if the arm could be brought to rest.
        """

    def signal(self, high: bool) -> None:
        """Switch the sync output, if there is one."""
