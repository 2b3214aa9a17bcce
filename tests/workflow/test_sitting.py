"""A sitting at the rig, with an arm and a camera in a process of their own."""

import time
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest
from tests.faults.small import NAME, PROJECT, REAL, SETTINGS
from tests.workflow.rig.driver import ask_arm
from tests.workflow.rig.sitting import Rig

from strandcast.records.motion import Motion
from strandcast.workflow.verify import verify

DRIVER = "Metadata-Version: 2.1\nName: socket-arm\nVersion: 1.0\n"


@pytest.fixture
def sitting(tmp_path: Path, finished: Path, request: pytest.FixtureRequest) -> Iterator[Rig]:
    """Return a rig with the faults of the test's parameter, and a driver from outside."""
    info = tmp_path / "site" / "socket_arm-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(DRIVER)
    (info / "entry_points.txt").write_text(
        "[strandcast.drivers]\nsocket = tests.workflow.rig.driver:socket_driver\n"
    )
    arm = (PROJECT / "config" / "arms" / "planar3.toml").read_text()
    rig = Rig(
        tmp_path,
        REAL,
        SETTINGS.removeprefix(REAL),
        "planar3.toml",
        arm.replace('name = "lab"', 'name = "socket"'),
        calibration=finished / "data" / NAME / "calibration",
        site=info.parent,
        faults=getattr(request, "param", {}),
    )
    yield rig
    rig.end()


FAULTS = {2: "no film", 3: "two films", 5: "other film", 6: "late film", 7: "stop"}
REASONS = (
    "there is no film",
    "there are several films: C0003.mp4, C0003b.mp4",
    "is the video of trial-02, byte for byte",
    "the hand moves",
    "protective stop: joint 2 met an obstacle",
)
TRIALS = [f"trial-{number:02d}" for number in range(1, 6)]


@pytest.mark.thorough
def test_after_a_power_loss_the_same_command_goes_on(sitting: Rig) -> None:
    sitting.start()
    sitting.throw()
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
    sitting.throw()
    sitting.until(r"score: trial 2")
    assert sitting.quit() == 0
    assert list(sitting.misses()) == [1, 2]
    assert sitting.aside() == {}


@pytest.mark.thorough
def test_another_computer_plays_and_leaves_its_log(sitting: Rig) -> None:
    sitting.arm_file.write_text(sitting.arm_file.read_text().split("[driver]")[0])
    sitting.start()
    for trial in (1, 2):
        sitting.throw()
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
    assert sitting.quit() == 0
    assert list(sitting.misses()) == [1, 2]


@pytest.mark.thorough
@pytest.mark.parametrize("sitting", [FAULTS], indirect=True)
def test_ten_throws_in_one_sitting_five_with_faults(sitting: Rig) -> None:
    sitting.start()
    for number in range(1, 11):
        found = sitting.until(r"trial (\d+) is next[\s\S]*?type (\w{8}) to throw it")
        sitting.type("yes")  # is no confirmation
        assert sitting.throw() == found[2]
        sitting.type(found[2])  # typed again, it must not throw again
        if FAULTS.get(number) == "no film":
            sitting.until("waiting for the film")
            time.sleep(3.0)
            sitting.type("none")
    assert sitting.quit() == 0
    assert list(sitting.misses()) == [1, 2, 3, 4, 5]
    for why, reason in zip(sitting.aside().values(), REASONS, strict=True):
        assert why.startswith(reason)
    pages = sitting.root / "results" / NAME
    assert sorted(path.parent.name for path in pages.glob("trial-*/report.html")) == TRIALS
    assert verify(sitting.root, NAME) == []
    armed = (sitting.root / "armed").read_text().split()
    assert armed == list("1222333345")  # the number of the trial before each throw
