"""What is refused before anything moves."""

from __future__ import annotations

import dataclasses
import os
import re
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import Arm, Box, Payload, load_arm
from strandcast.errors import REFUSED, StrandcastError
from strandcast.player.play import play
from strandcast.player.protocol import State
from strandcast.player.rehearsal import Rehearsal, Terms, rehearse, slowed
from strandcast.player.surroundings import one_run
from strandcast.player.words import lines_of

from .test_play import START, PerfectArm, make_motion
from .virtual import VirtualClock

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def arm() -> Arm:
    return load_arm(ROOT / "config" / "arms" / "planar3.toml")


class TellingArm(PerfectArm):
    """An arm that tells of itself what it is given, state after state (the last one for ever)."""

    def __init__(self, *told: dict[str, object]) -> None:
        super().__init__()
        self.told = list(told)

    def state(self) -> State:
        told = self.told.pop(0) if len(self.told) > 1 else self.told[0]
        return dataclasses.replace(State(self.q_rad, np.zeros(3)), **told)


def rehearsed(arm: Arm, folder: Path, driver: PerfectArm | None = None, **terms: object) -> Rehearsal:
    make_motion(arm).write(folder / "planned.json")
    driver = driver or PerfectArm()
    return rehearse(folder / "planned.json", arm, driver, folder / "run", Terms(**terms), VirtualClock())


def told_of(arm: Arm) -> Arm:
    """Return the arm with a payload and a held joint, as its file could tell."""
    return dataclasses.replace(arm, payload=Payload(0.2, (0.0, 0.0, 0.0)), held={"wrist": 0.5})


def assert_refused(arm: Arm, folder: Path, driver: PerfectArm, words: str) -> None:
    rehearsal = dataclasses.replace(rehearsed(arm, folder, driver), arm=told_of(arm))
    with pytest.raises(StrandcastError, match=words) as caught:
        play(rehearsal, driver, rehearsal.short_hash, VirtualClock())
    assert caught.value.exit_code == REFUSED
    assert not driver.played
    assert driver.stopped == 1
    assert not (folder / "run").exists()


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"trouble": "emergency stop pressed"}, "SC-X005.*emergency stop"),
        ({"speed_scaling": 0.9}, "SC-X005.*speed scaling is 90 %"),
        ({"payload_kg": 0.9}, r"SC-X005.*told of 0\.900 kg"),
        ({"q_held_rad": {"wrist": 0.52}}, r"SC-X006.*wrist is 0\.0200 rad"),
        ({"q_rad": np.array([np.nan, -0.6, -0.3])}, "SC-X006.*joint_1"),
        ({"qd_rad_s": np.full(3, 0.02)}, "SC-X007"),
        ({"time_s": 12.5}, "SC-X005.*clock stands still"),
    ],
)
def test_an_arm_that_cannot_play_is_refused(
    arm: Arm, tmp_path: Path, told: dict[str, object], words: str
) -> None:
    assert_refused(arm, tmp_path, TellingArm(told), words)


def test_trouble_while_waiting_is_seen(arm: Arm, tmp_path: Path) -> None:
    assert_refused(arm, tmp_path, TellingArm({}, {}, {}, {"trouble": "brakes closed"}), "brakes closed")


def test_an_arm_in_trouble_is_not_moved_to_the_start_either(
    arm: Arm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = TellingArm({"speed_scaling": 0.5}, {})
    monkeypatch.setattr(driver, "move_to_start", lambda q_rad: pytest.fail("it was moved"))
    rehearsal = rehearsed(arm, tmp_path, driver, move_to_start=True)
    with pytest.raises(StrandcastError, match="SC-X005"):
        play(rehearsal, driver, rehearsal.short_hash, VirtualClock())


def test_an_arm_that_still_settles_is_waited_for(arm: Arm, tmp_path: Path) -> None:
    moving = {"qd_rad_s": np.full(3, 0.02)}
    driver = TellingArm(*[moving] * 30, {"qd_rad_s": np.zeros(3)})
    rehearsal = rehearsed(arm, tmp_path, driver)
    clock = VirtualClock()
    assert play(rehearsal, driver, rehearsal.short_hash, clock).complete
    assert clock.since_s == pytest.approx(29 * 0.02 + 0.3, abs=0.05)


def test_only_the_right_hash_moves_the_arm(arm: Arm, tmp_path: Path) -> None:
    driver = PerfectArm()
    rehearsal = rehearsed(arm, tmp_path, driver)
    for wrong in ("", "y", rehearsal.short_hash[:-1], slowed(rehearsal.motion, 2.0).content_sha256()[:8]):
        with pytest.raises(StrandcastError, match="SC-X012") as caught:
            play(rehearsal, driver, wrong, VirtualClock())
        assert caught.value.exit_code == REFUSED
    assert not driver.played
    assert driver.stopped == 0


def test_hand_and_string_must_stay_in_the_workspace(arm: Arm, tmp_path: Path) -> None:
    assert rehearsed(arm, tmp_path).reach.hand_m[0, 1] < 0.8
    narrow = dataclasses.replace(arm, workspace=Box((-0.8, 0.8), (-0.8, 0.8)))
    assert rehearsed(narrow, tmp_path)
    with pytest.raises(StrandcastError, match=r"SC-X008.*0\.50 m hanging") as caught:
        rehearsed(narrow, tmp_path, hanging_m=0.5)
    assert caught.value.exit_code == REFUSED


def test_the_way_to_the_start_is_checked_too(arm: Arm, tmp_path: Path) -> None:
    driver = PerfectArm(q_rad=START + np.array([0.0, 0.0, 2.5]))  # beyond joint_3's range
    rehearsal = rehearsed(arm, tmp_path, driver, move_to_start=True)
    with pytest.raises(StrandcastError, match="SC-X004.*the move to the start: joint_3"):
        play(rehearsal, driver, rehearsal.short_hash, VirtualClock())
    assert not driver.played


def test_the_string_gets_time_to_hang_still_after_the_slow_way(arm: Arm, tmp_path: Path) -> None:
    driver, clock = PerfectArm(START + 0.2), VirtualClock()
    rehearsal = rehearsed(arm, tmp_path, driver, move_to_start=True, settle_s=20.0)
    moved_s = []
    move = driver.move_to_start
    driver.move_to_start = lambda q: (move(q), moved_s.append(clock.since_s))
    throw = driver.play
    driver.play = lambda *given: (moved_s.append(clock.since_s), throw(*given))[1]
    assert play(rehearsal, driver, rehearsal.short_hash, clock).complete
    assert moved_s[1] - moved_s[0] == pytest.approx(20.3, abs=0.05)


def test_one_run_moves_an_arm(arm: Arm, tmp_path: Path) -> None:
    driver = PerfectArm()
    driver.address = f"test-{os.getpid()}"
    rehearsal = rehearsed(arm, tmp_path, driver)
    with one_run(driver.address), pytest.raises(StrandcastError, match="SC-X016"):
        play(rehearsal, driver, rehearsal.short_hash, VirtualClock())
    assert not driver.played
    assert play(rehearsal, driver, rehearsal.short_hash, VirtualClock()).complete


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user for a moment")
def test_another_user_of_the_host_can_move_the_arm_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    with tempfile.TemporaryDirectory() as shared:
        Path(shared).chmod(0o1777)
        monkeypatch.setattr(tempfile, "tempdir", shared)
        with one_run("192.0.2.7"):
            pass
        os.seteuid(65534)
        try:
            with one_run("192.0.2.7"), pytest.raises(StrandcastError, match="SC-X016"), one_run("192.0.2.7"):
                pass
        finally:
            os.seteuid(0)


def test_a_motion_from_the_future_is_a_wrong_clock(arm: Arm, tmp_path: Path) -> None:
    make_motion(arm).write(tmp_path / "planned.json")
    later = time.time() + 3600
    os.utime(tmp_path / "planned.json", (later, later))
    with pytest.raises(StrandcastError, match="SC-X015"):
        rehearse(tmp_path / "planned.json", arm, PerfectArm(), tmp_path / "run")


def test_a_faster_motion_is_no_time_scale(arm: Arm) -> None:
    with pytest.raises(StrandcastError, match="SC-X017"):
        slowed(make_motion(arm), 0.5)


def test_the_dry_run_tells_peaks_that_can_be_worked_out(arm: Arm, tmp_path: Path) -> None:
    rehearsal = rehearsed(arm, tmp_path, time_scale=4.0)
    words = "\n".join(lines_of(rehearsal))
    # The quintic's largest speed is 15/8 of the mean one: 0.8 rad in 2 s.
    assert "peak speed [rad/s], of the limit: 0.75 (8 %), 0.75" in words
    assert "2.000 s, 4 times slower" in words
    assert "  from joint_1 0.400, joint_2 -0.600, joint_3 -0.300 rad" in words
    assert "torque is not checked" not in words
    assert rehearsal.short_hash in words
    assert not (tmp_path / "run").exists()


def test_a_torque_that_nothing_weighs_is_not_told_as_one(tmp_path: Path) -> None:
    planar3 = ROOT / "config" / "arms" / "planar3"
    urdf = re.sub(r"<inertial>.*?</inertial>", "", planar3.with_suffix(".urdf").read_text(), flags=re.DOTALL)
    (tmp_path / "planar3.urdf").write_text(urdf)
    (tmp_path / "arm.toml").write_text(planar3.with_suffix(".toml").read_text())
    words = "\n".join(lines_of(rehearsed(load_arm(tmp_path / "arm.toml"), tmp_path)))
    assert "peak torque [N m], of the limit: not known" in words
    assert "warning: torque is not checked: planar3.urdf gives no mass to what joint_1, joint_2," in words
