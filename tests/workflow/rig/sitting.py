"""A sitting: a project, the lab that films its throws, and the terminal of `strandcast throw`."""

import json
import os
import pty
import re
import select
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from tests.faults.small import NAME, PROJECT, environment, make_project, run_stages

from strandcast.records.verdict import Verdict

SITTING = """\
sitting:
  folder: films
  before: "{python} -c 'open(\\"armed\\", \\"a\\").write(\\"{{trial}} \\")'"
  wait_s: 60
"""
LONGEST_S = 900.0  # a busy machine plans slowly


class Rig:
    """A project with a sitting's experiment, the rig as a process, and the terminal of `strandcast throw`.

    Parameters
    ----------
    settings, lab
        Of the experiment, and what the lab adds to them.
    arm_file, arm
        The name of the arm's file, and its text.
    calibration
        A folder of photos of the boards; by default, the lab takes them.
    site
        A folder of further packages.
    faults
        See `tests.workflow.rig.process`.
    """

    def __init__(
        self,
        folder: Path,
        settings: str,
        lab: str,
        arm_file: str,
        arm: str,
        *,
        calibration: Path | None = None,
        site: Path | None = None,
        faults: dict[int, str] | None = None,
    ) -> None:
        self.root, self.lab = make_project(folder / "project"), make_project(folder / "lab")
        sitting = SITTING.format(python=sys.executable)
        for root, more in ((self.root, sitting), (self.lab, lab)):
            (root / "config" / "arms" / arm_file).write_text(arm)
            (root / "config" / "experiments" / f"{NAME}.yaml").write_text(settings + more)
        self.arm_file = self.root / "config" / "arms" / arm_file
        if calibration is None:
            run_stages(self.lab, [["lab_calibrate", NAME]])
            calibration = self.lab / "data" / NAME / "calibration"
        shutil.copytree(calibration, self.root / "data" / NAME / "calibration")
        self.films, self.port = self.root / "films", folder / "port"
        self.films.mkdir()
        (self.films / "C0000.mp4").write_bytes(b"an old film")
        path = os.pathsep.join(map(str, (PROJECT / "src", PROJECT, *([site] if site else []))))
        self.environment = environment(PYTHONPATH=path, RIG_PORT=str(self.port))
        line = [sys.executable, "-m", "tests.workflow.rig.process", str(self.lab), NAME, str(self.films)]
        line += [str(self.port), json.dumps(faults or {})]
        self.process = subprocess.Popen(line, env=self.environment)
        self.text, self._terminal, self._sitting = "", -1, None

    def start(self, *options: str) -> None:
        """Start `strandcast throw` in a terminal."""
        self._terminal, inside = pty.openpty()
        line = [sys.executable, "-m", "strandcast", "throw", NAME, "--move-to-start", *options]
        self._sitting = subprocess.Popen(
            line, cwd=self.root, env=self.environment, stdin=inside, stdout=inside, stderr=inside
        )
        os.close(inside)

    def until(self, *patterns: str) -> re.Match[str]:
        """Read the terminal until one of some patterns appears; what comes after it is read next time."""
        end_s = time.monotonic() + LONGEST_S
        while time.monotonic() < end_s:
            for pattern in patterns:
                if found := re.search(pattern, self.text):
                    self.text = self.text[found.end() :]
                    return found
            if select.select([self._terminal], [], [], 0.2)[0]:
                try:
                    self.text += os.read(self._terminal, 1 << 16).decode(errors="replace")
                except OSError:
                    break
        raise AssertionError(f"none of {patterns} in: {self.text[-3000:]}")

    def type(self, text: str) -> None:
        """Type a line."""
        os.write(self._terminal, f"{text}\n".encode())

    def throw(self) -> str:
        """Type what the sitting asks for; return the motion's hash."""
        wanted = self.until(r"type (\w{8}) to throw it")[1]
        self.type(wanted)
        return wanted

    def quit(self) -> int:
        """End the sitting where it asks; return its exit code."""
        self.until(r"type (\w{8}) to throw it")
        self.type("q")
        assert self._sitting is not None
        return self._sitting.wait(30)

    def interrupt(self, how: signal.Signals = signal.SIGKILL) -> None:
        """Interrupt the sitting: by default kill it, as a power loss does."""
        assert self._sitting is not None
        self._sitting.send_signal(how)
        if how == signal.SIGKILL:
            self._sitting.wait()
            self.text = ""

    def end(self) -> None:
        """End all processes."""
        for process in (self.process, self._sitting):
            if process is not None:
                process.kill()
                process.wait()

    def misses(self) -> dict[int, float | None]:
        """Return the miss of each trial that counts."""
        folders = sorted((self.root / "data" / NAME).glob("trial-*"))
        verdicts = [self.root / "results" / NAME / folder.name / "verdict.json" for folder in folders]
        return {verdict.trial: verdict.miss_m for verdict in map(Verdict.read, verdicts)}

    def aside(self) -> dict[str, str]:
        """Return why trials were put aside, by their folders."""
        folder = self.root / "data" / NAME / "aside"
        return {path.parent.name: path.read_text().strip() for path in sorted(folder.glob("*/why.txt"))}
