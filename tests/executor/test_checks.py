"""Refusals before anything moves."""

import dataclasses
import os
import re
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.arm.settings import Payload
from strandcast.errors import REFUSED, StrandcastError
from strandcast.executor.drivers.protocol import ArmState
from strandcast.executor.dry_run_report import dry_run_report
from strandcast.executor.locks import one_run
from strandcast.executor.play import play
from strandcast.executor.preflight import PlayOptions, Preflight, run_preflight, slowed

from .test_play import START, PerfectArm, make_motion
from .virtual import VirtualClock

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def arm() -> PlanarArm:
    return load_arm(ROOT / "config" / "arms" / "planar3.toml").planar()


class ScriptedArm(PerfectArm):
    """An arm that reports the given states one after another, then the last one forever."""

    def __init__(self, *given: dict[str, object]) -> None:
        super().__init__()
        self.given = list(given)

    def state(self) -> ArmState:
        given = self.given.pop(0) if len(self.given) > 1 else self.given[0]
        return dataclasses.replace(ArmState(self.q_rad, np.zeros(3)), **given)


def preflight_of(
    arm: PlanarArm, folder: Path, driver: PerfectArm | None = None, **options: object
) -> Preflight:
    make_motion(arm).write(folder / "planned.json")
    driver = driver or PerfectArm()
    return run_preflight(
        folder / "planned.json", arm, driver, folder / "run", PlayOptions(**options), VirtualClock()
    )


def with_payload_and_held_joint(arm: PlanarArm) -> PlanarArm:
    """Return the arm with a payload and a held joint, as its file could declare."""
    payload = Payload(mass_kg=0.2)
    return dataclasses.replace(arm, payload=payload, held={"wrist": 0.5})


def assert_refused(arm: PlanarArm, folder: Path, driver: PerfectArm, message: str) -> None:
    preflight = dataclasses.replace(preflight_of(arm, folder, driver), arm=with_payload_and_held_joint(arm))
    with pytest.raises(StrandcastError, match=message) as caught:
        play(preflight, driver, preflight.short_hash, VirtualClock())
    assert caught.value.exit_code == REFUSED
    assert not driver.played
    assert driver.stopped == 1
    assert not (folder / "run").exists()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"fault": "emergency stop pressed"}, "SC-X005.*emergency stop"),
        ({"speed_scaling": 0.9}, "SC-X005.*speed scaling is 90 %"),
        ({"payload_kg": 0.9}, r"SC-X005.*payload is 0\.900 kg"),
        ({"q_held_rad": {"wrist": 0.52}}, r"SC-X006.*wrist is 0\.0200 rad"),
        ({"q_rad": np.array([np.nan, -0.6, -0.3])}, "SC-X006.*joint_1"),
        ({"qd_rad_s": np.full(3, 0.02)}, "SC-X007"),
        ({"time_s": 12.5}, "SC-X005.*clock has stopped"),
    ],
)
def test_an_arm_that_cannot_play_is_refused(
    arm: PlanarArm, tmp_path: Path, given: dict[str, object], message: str
) -> None:
    assert_refused(arm, tmp_path, ScriptedArm(given), message)


def test_a_fault_while_waiting_is_refused(arm: PlanarArm, tmp_path: Path) -> None:
    assert_refused(arm, tmp_path, ScriptedArm({}, {}, {}, {"fault": "brakes closed"}), "brakes closed")


def test_an_arm_with_a_fault_is_not_moved_to_the_start(
    arm: PlanarArm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = ScriptedArm({"speed_scaling": 0.5}, {})
    monkeypatch.setattr(driver, "move_to_start", lambda q_rad: pytest.fail("it was moved"))
    preflight = preflight_of(arm, tmp_path, driver, move_to_start=True)
    with pytest.raises(StrandcastError, match="SC-X005"):
        play(preflight, driver, preflight.short_hash, VirtualClock())


def test_the_player_waits_for_an_arm_that_is_settling(arm: PlanarArm, tmp_path: Path) -> None:
    moving = {"qd_rad_s": np.full(3, 0.02)}
    driver = ScriptedArm(*[moving] * 30, {"qd_rad_s": np.zeros(3)})
    preflight = preflight_of(arm, tmp_path, driver)
    clock = VirtualClock()
    assert play(preflight, driver, preflight.short_hash, clock).complete
    assert clock.since_s == pytest.approx(29 * 0.02 + 0.3, abs=0.05)


def test_only_the_right_hash_moves_the_arm(arm: PlanarArm, tmp_path: Path) -> None:
    driver = PerfectArm()
    preflight = preflight_of(arm, tmp_path, driver)
    for wrong in ("", "y", preflight.short_hash[:-1], slowed(preflight.motion, 2.0).content_sha256()[:8]):
        with pytest.raises(StrandcastError, match="SC-X012") as caught:
            play(preflight, driver, wrong, VirtualClock())
        assert caught.value.exit_code == REFUSED
    assert not driver.played
    assert driver.stopped == 0


def test_what_was_checked_is_played(arm: PlanarArm, tmp_path: Path) -> None:
    driver = PerfectArm()
    preflight = preflight_of(arm, tmp_path, driver)
    play(preflight, driver, preflight.short_hash, VirtualClock())
    assert driver.played == [preflight.command]


def test_hand_and_string_must_stay_in_the_workspace(arm: PlanarArm, tmp_path: Path) -> None:
    assert preflight_of(arm, tmp_path).reach.hand_m[0, 1] < 0.8
    narrow = dataclasses.replace(arm, box_m=np.array([[-0.8, 0.8]] * 2))
    assert preflight_of(narrow, tmp_path)
    with pytest.raises(StrandcastError, match=r"SC-X004.*0\.50 m hanging") as caught:
        preflight_of(narrow, tmp_path, hanging_m=0.5)
    assert caught.value.exit_code == REFUSED


def test_the_path_to_the_start_is_checked(arm: PlanarArm, tmp_path: Path) -> None:
    driver = PerfectArm(q_rad=START + np.array([0.0, 0.0, 2.5]))  # beyond joint_3's range
    preflight = preflight_of(arm, tmp_path, driver, move_to_start=True)
    with pytest.raises(StrandcastError, match="SC-X004.*the move to the start: joint_3"):
        play(preflight, driver, preflight.short_hash, VirtualClock())
    assert not driver.played


def test_the_string_gets_time_to_settle_after_the_slow_move(arm: PlanarArm, tmp_path: Path) -> None:
    driver, clock = PerfectArm(START + 0.2), VirtualClock()
    preflight = preflight_of(arm, tmp_path, driver, move_to_start=True, settle_s=20.0)
    moved_s = []
    move = driver.move_to_start
    driver.move_to_start = lambda q: (move(q), moved_s.append(clock.since_s))
    throw = driver.play
    driver.play = lambda *given: (moved_s.append(clock.since_s), throw(*given))[1]
    assert play(preflight, driver, preflight.short_hash, clock).complete
    assert moved_s[1] - moved_s[0] == pytest.approx(20.3, abs=0.05)


def test_only_one_run_at_a_time_moves_an_arm(arm: PlanarArm, tmp_path: Path) -> None:
    driver = PerfectArm()
    driver.address = f"test-{os.getpid()}"
    preflight = preflight_of(arm, tmp_path, driver)
    with one_run(driver.address), pytest.raises(StrandcastError, match="SC-W010"):
        play(preflight, driver, preflight.short_hash, VirtualClock())
    assert not driver.played
    assert play(preflight, driver, preflight.short_hash, VirtualClock()).complete


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user for a moment")
def test_another_user_can_move_the_arm_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    with tempfile.TemporaryDirectory() as shared:
        Path(shared).chmod(0o1777)
        monkeypatch.setattr(tempfile, "tempdir", shared)
        with one_run("192.0.2.7"):
            pass
        os.seteuid(65534)
        try:
            with one_run("192.0.2.7"), pytest.raises(StrandcastError, match="SC-W010"), one_run("192.0.2.7"):
                pass
        finally:
            os.seteuid(0)


def test_a_motion_from_the_future_means_a_wrong_clock(arm: PlanarArm, tmp_path: Path) -> None:
    make_motion(arm).write(tmp_path / "planned.json")
    later = time.time() + 3600
    os.utime(tmp_path / "planned.json", (later, later))
    with pytest.raises(StrandcastError, match="SC-W007"):
        run_preflight(tmp_path / "planned.json", arm, PerfectArm(), tmp_path / "run")


def test_a_time_scale_below_one_is_refused(arm: PlanarArm) -> None:
    with pytest.raises(StrandcastError, match="SC-W020"):
        slowed(make_motion(arm), 0.5)


def test_the_dry_run_reports_peaks_that_can_be_worked_out_by_hand(arm: PlanarArm, tmp_path: Path) -> None:
    preflight = preflight_of(arm, tmp_path, time_scale=4.0)
    report = "\n".join(dry_run_report(preflight))
    # The quintic's largest speed is 15/8 of the mean one: 0.8 rad in 2 s.
    assert "peak speed [rad/s] (share of the limit): 0.75 (8 %), 0.75" in report
    assert "2.000 s, 4 times slower" in report
    assert "  from joint_1 0.400, joint_2 -0.600, joint_3 -0.300 rad" in report
    assert "torque is not checked" not in report
    assert preflight.short_hash in report
    assert not (tmp_path / "run").exists()


def test_without_masses_no_torque_is_reported(tmp_path: Path) -> None:
    planar3 = ROOT / "config" / "arms" / "planar3"
    urdf = re.sub(r"<inertial>.*?</inertial>", "", planar3.with_suffix(".urdf").read_text(), flags=re.DOTALL)
    (tmp_path / "planar3.urdf").write_text(urdf)
    (tmp_path / "arm.toml").write_text(planar3.with_suffix(".toml").read_text())
    report = "\n".join(dry_run_report(preflight_of(load_arm(tmp_path / "arm.toml").planar(), tmp_path)))
    assert "peak torque [N m] (share of the limit): not known" in report
    assert "warning: torque is not checked: planar3.urdf gives no mass to what joint_1, joint_2," in report
