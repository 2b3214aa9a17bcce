"""A real FCI server, franka-sim, for the driver's tests; in an environment and a process of its own."""

from __future__ import annotations

import os
import random
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

PORT = 1337  # the client's own, not to be chosen
START_S = 60.0
READY = "Server ready for new client"
HERE = Path(__file__).parent


def python() -> str:
    """Return the Python of franka-sim's environment; skip the test where there is none."""
    here = HERE.parents[2] / ".venv-franka-sim" / "bin" / "python"
    named = os.environ.get("STRANDCAST_FRANKA_SIM") or (str(here) if here.exists() else None)
    if named is None:
        pytest.skip("franka-sim is not installed: make test-drivers")
    return named


@contextmanager
def served(folder: Path, longest_s: float = 400.0) -> Iterator[Server]:
    """Run a server, and end it afterwards, or by itself after so long."""
    server = Server(folder, longest_s)
    try:
        server.wait_until_ready()
        yield server
    finally:
        server.kill()


class Server:
    """A running server.

    The port is fixed by the protocol: an address of its own on the loopback lets several run side by side.
    """

    def __init__(self, folder: Path, longest_s: float) -> None:
        self.host = ".".join(map(str, [127, *(random.randint(1, 250) for _ in range(3))]))
        self._log = folder / "franka-sim.log"
        with self._log.open("w") as log:
            # -P: this folder's own franka_sim.py must not hide the package.
            self.process = subprocess.Popen(
                [
                    *(python(), "-P", str(HERE / "franka_sim_server.py"), self.host),
                    *(str(folder / "fr3.xml"), str(longest_s)),
                ],
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def wait_until_ready(self) -> None:
        """Wait until it listens."""
        deadline = time.monotonic() + START_S
        while READY not in self._log.read_text():
            if self.process.poll() is not None or time.monotonic() > deadline:
                pytest.fail(f"franka-sim did not start:\n{self._log.read_text()[-2000:]}")
            time.sleep(0.05)

    def kill(self) -> None:
        """End the process at once, as a controller that loses its power."""
        self.process.kill()
        self.process.wait()

    def asked(self, command: str) -> int:
        """Return how often clients have sent a command so far, "Move" for one."""
        return self._log.read_text().count(f"command: k{command} ")

    def ended(self) -> int:
        """Return how many motions clients have ended themselves so far, as finished."""
        return self._log.read_text().count("Control session ended (motion finished)")
