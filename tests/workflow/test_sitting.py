"""A sitting at the rig, with an arm and a camera in a process of their own."""

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
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest
from tests.faults.small import NAME, PROJECT, REAL, environment, make_project
from tests.workflow.rig.driver import ask_arm

from strandcast.records.motion import Motion
from strandcast.records.verdict import Verdict
from strandcast.workflow.verify import verify

SITTING = """\
sitting:
  folder: films
  before: "{python} -c 'open(\\"armed\\", \\"a\\").write(\\"{{trial}} \\")'"
  wait_s: 60
"""
DRIVER = "Metadata-Version: 2.1\nName: socket-arm\nVersion: 1.0\n"
LONGEST_S = 300.0


class Rig:
    """A project with a sitting's experiment, the rig as a process, and the terminal of `strandcast throw`."""

    def __init__(self, folder: Path, finished: Path, faults: dict[int, str]) -> None:
        self.root = make_project(folder / "project")
        self.lab = make_project(folder / "lab")
        for experiment in (self.root, self.lab):
            arm = experiment / "config" / "arms" / "planar3.toml"
            arm.write_text(arm.read_text().replace('name = "lab"', 'name = "socket"'))
        shutil.copytree(finished / "data" / NAME / "calibration", self.root / "data" / NAME / "calibration")
        settings = REAL + SITTING.format(python=sys.executable)
        (self.root / "config" / "experiments" / f"{NAME}.yaml").write_text(settings)
        self.films, self.port = self.root / "films", folder / "port"
        self.films.mkdir()
        (self.films / "C0000.mp4").write_bytes(b"an old film")
        info = folder / "site" / "socket_arm-1.0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(DRIVER)
        (info / "entry_points.txt").write_text(
            "[strandcast.drivers]\nsocket = tests.workflow.rig.driver:socket_driver\n"
        )
        path = os.pathsep.join(map(str, (PROJECT / "src", PROJECT, folder / "site")))
        self.environment = environment(PYTHONPATH=path, RIG_PORT=str(self.port))
        line = [sys.executable, "-m", "tests.workflow.rig.process", str(self.lab), NAME, str(self.films)]
        self.process = subprocess.Popen([*line, str(self.port), json.dumps(faults)], env=self.environment)
        self.text, self._terminal, self._sitting = "", -1, None

    def start(self) -> None:
        """Start `strandcast throw` in a terminal."""
        self._terminal, inside = pty.openpty()
        line = [sys.executable, "-m", "strandcast", "throw", NAME, "--move-to-start"]
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

    def interrupt(self) -> None:
        """Kill the sitting, as a power loss does."""
        assert self._sitting is not None
        self._sitting.send_signal(signal.SIGKILL)
        self._sitting.wait()
        self.text = ""

    def end(self) -> int:
        """Return the exit code of the sitting."""
        assert self._sitting is not None
        return self._sitting.wait(30)

    def misses(self) -> dict[int, float | None]:
        """Return the miss of each trial that counts."""
        folders = sorted((self.root / "data" / NAME).glob("trial-*"))
        verdicts = [self.root / "results" / NAME / folder.name / "verdict.json" for folder in folders]
        return {verdict.trial: verdict.miss_m for verdict in map(Verdict.read, verdicts)}

    def aside(self) -> dict[str, str]:
        """Return why trials were put aside, by their folders."""
        folder = self.root / "data" / NAME / "aside"
        return {path.parent.name: path.read_text().strip() for path in sorted(folder.glob("*/why.txt"))}


@pytest.fixture
def sitting(tmp_path: Path, finished: Path, request: pytest.FixtureRequest) -> Iterator[Rig]:
    """Return a rig with the faults of the test's parameter."""
    rig = Rig(tmp_path, finished, getattr(request, "param", {}))
    yield rig
    rig.process.kill()


FAULTS = {2: "no film", 3: "two films", 5: "other film", 6: "late film", 7: "stop"}
REASONS = (
    "there is no film",
    "there are several films: C0003.mp4, C0003b.mp4",
    "is the video of trial-02, byte for byte",
    "the hand moves",
    "protective stop: joint 2 met an obstacle",
)
TRIALS = [f"trial-{number:02d}" for number in range(1, 6)]


def throw(sitting: Rig) -> str:
    """Type what the sitting asks for; return the motion's hash."""
    wanted = sitting.until(r"type (\w{8}) to throw it")[1]
    sitting.type(wanted)
    return wanted


@pytest.mark.thorough
def test_after_a_power_loss_the_same_command_goes_on(sitting: Rig) -> None:
    sitting.start()
    throw(sitting)
    while not (sitting.root / "data" / NAME / "trial-01" / "run.json").is_file():
        time.sleep(0.05)
    sitting.interrupt()
    film = sitting.films / "C0001.mp4"
    while not film.is_file() or time.time() - film.stat().st_mtime < 1.0:
        time.sleep(0.1)
    sitting.start()
    sitting.until("track of trial 1")
    sitting.interrupt()
    sitting.start()
    sitting.until(r"score: trial 1", r"trial 2 is next")
    throw(sitting)
    sitting.until(r"score: trial 2")
    sitting.until(r"type (\w{8}) to throw it")
    sitting.type("q")
    assert sitting.end() == 0
    assert list(sitting.misses()) == [1, 2]
    assert sitting.aside() == {}


@pytest.mark.thorough
def test_another_computer_plays_and_leaves_its_log(sitting: Rig) -> None:
    arm = sitting.root / "config/arms/planar3.toml"
    arm.write_text(arm.read_text().split("[driver]")[0])
    sitting.start()
    for trial in (1, 2):
        throw(sitting)
        path = sitting.until(r"play it now: (\S+)")[1]
        sitting.until("waiting for the joint log")
        motion = Motion.read(sitting.root / path)
        answer = ask_arm(motion.trajectory(), sitting.port.read_text())
        log = pd.DataFrame({"timestamp": answer["log"]["time_s"]})
        for name, column in {
            "actual_q": "q_rad",
            "target_q": "q_cmd_rad",
            "target_qd": "qd_cmd_rad_s",
        }.items():
            for joint, values in enumerate(zip(*answer["log"][column], strict=True)):
                log[f"{name}_{joint}"] = values
        log.to_csv(sitting.films / f"log-{trial}.csv", index=False)
        sitting.until(rf"score: trial {trial}")
    sitting.until(r"type (\w{8}) to throw it")
    sitting.type("q")
    assert sitting.end() == 0
    assert list(sitting.misses()) == [1, 2]


@pytest.mark.thorough
@pytest.mark.parametrize("sitting", [FAULTS], indirect=True)
def test_ten_throws_in_one_sitting_five_with_faults(sitting: Rig) -> None:
    sitting.start()
    for number in range(1, 11):
        found = sitting.until(r"trial (\d+) is next[\s\S]*?type (\w{8}) to throw it")
        sitting.type("yes")  # is no confirmation
        assert throw(sitting) == found[2]
        sitting.type(found[2])  # typed again, it must not throw again
        if FAULTS.get(number) == "no film":
            sitting.until("waiting for the film")
            time.sleep(3.0)
            sitting.type("none")
    sitting.until("type (\\w{8}) to throw it")
    sitting.type("q")
    assert sitting.end() == 0
    assert list(sitting.misses()) == [1, 2, 3, 4, 5]
    for why, reason in zip(sitting.aside().values(), REASONS, strict=True):
        assert why.startswith(reason)
    pages = sitting.root / "results" / NAME
    assert sorted(path.parent.name for path in pages.glob("trial-*/report.html")) == TRIALS
    assert verify(sitting.root, NAME) == []
    armed = (sitting.root / "armed").read_text().split()
    assert armed == list("1222333345")  # the number of the trial before each throw
