import json
import resource
import subprocess
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from strandcast.arm.load import Arm, PlanarArm, load_arm
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import ENVIRONMENT, LOG_INCOMPLETE, REFUSED, StrandcastError
from strandcast.executor.drivers.protocol import ArmState, Driver, Recording
from strandcast.executor.move_to_start import slow_trajectory
from strandcast.executor.play import play as play_checked
from strandcast.executor.preflight import PlayOptions, run_preflight
from strandcast.records.joint_log import JointLog, Run, read_run
from strandcast.records.motion import Motion

from .motions import swing
from .virtual import VirtualClock

ROOT = Path(__file__).parents[2]
START = np.array([0.4, -0.6, -0.3])


class PerfectArm:
    """An arm that follows every command exactly; it counts the moves to the start."""

    name = "perfect"
    rate_hz = 500.0
    streams = False
    address = None

    def __init__(self, q_rad: np.ndarray = START, status: str = "ok", speed_rad_s: float = 0.0) -> None:
        self.q_rad, self.status, self.speed_rad_s = np.array(q_rad), status, speed_rad_s
        self.played: list[JointTrajectory] = []
        self.stopped = 0
        self.lose: slice | None = None  # rows of the log

    def connect(self) -> None:
        pass

    def state(self) -> ArmState:
        return ArmState(self.q_rad, np.full(3, self.speed_rad_s))

    def move_to_start(self, q_rad: np.ndarray) -> None:
        self.q_rad = np.array(q_rad)

    def play(self, command: JointTrajectory, folder: Path) -> Recording:
        self.played.append(command)
        count = len(command.time_s) + 500
        time_s = 10.0 + np.arange(count) / self.rate_hz
        rows = np.clip(np.arange(count) - 250, 0, len(command.time_s) - 1)
        log = JointLog(
            ["joint_1", "joint_2", "joint_3"],
            time_s,
            command.q_rad[rows],
            command.qd_rad_s[rows],
            command.q_rad[rows],
            command.qd_rad_s[rows],
            np.full(count, np.nan),
            np.zeros(count, np.int32),
        )
        end = 10.5 + command.time_s[-1]
        if self.lose is not None:
            kept = np.delete(np.arange(count), self.lose)
            log = JointLog(log.joint_names, *[values[kept] for values in list(vars(log).values())[1:8]])
        return Recording(log, self.status, None if self.status == "ok" else "pulled", 10.5, end, "perfect")

    def stop(self) -> None:
        self.stopped += 1


@pytest.fixture(scope="module")
def arm() -> PlanarArm:
    return load_arm(ROOT / "config" / "arms" / "planar3.toml").planar()


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk with little more than the player requires."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=80m", "small", folder], check=False)
    if mounted.returncode:
        pytest.skip("only root can mount a small disk")
    yield folder
    subprocess.run(["umount", "--lazy", folder], check=True)


@pytest.fixture
def motion(arm: PlanarArm) -> Motion:
    return make_motion(arm)


def make_motion(arm: PlanarArm, by: float = 0.8, duration_s: float = 0.5) -> Motion:
    return swing(arm, START, by, duration_s)


def play(path: Path, arm: PlanarArm, driver: Driver, out_dir: Path, **options: object) -> Run:
    preflight = run_preflight(path, arm, driver, out_dir, PlayOptions(**options))
    return play_checked(preflight, driver, preflight.short_hash, VirtualClock())


def test_a_motion_is_played_and_logged(arm: PlanarArm, motion: Motion, tmp_path: Path) -> None:
    motion.write(tmp_path / "planned.json")
    (tmp_path / "predicted.parquet").write_bytes(b"the throws that are expected of it")
    driver = PerfectArm()
    play(tmp_path / "planned.json", arm, driver, tmp_path / "trial-01")
    run, log = read_run(tmp_path / "trial-01")
    assert run.complete
    assert run.motion_sha256 == motion.content_sha256()
    assert run.rows == len(log.time_s) == 751
    assert (tmp_path / "trial-01" / "motion.json").read_bytes() == (tmp_path / "planned.json").read_bytes()
    kept, given = (place / "predicted.parquet" for place in (tmp_path / "trial-01", tmp_path))
    assert kept.read_bytes() == given.read_bytes()
    np.testing.assert_allclose(driver.played[0].q_rad, motion.trajectory().q_rad, atol=1e-12)
    assert driver.stopped == 1


def test_between_the_points_the_motion_is_smooth(arm: PlanarArm, motion: Motion) -> None:
    fine = motion.trajectory().resampled(1e-4)
    s = fine.time_s / 0.5
    np.testing.assert_allclose(fine.q_rad[:, 0], START[0] + 0.8 * s**3 * (10 - 15 * s + 6 * s**2), atol=1e-9)
    np.testing.assert_allclose(fine.qd_rad_s[:, 0], 0.8 * 30 * s**2 * (1 - s) ** 2 / 0.5, atol=1e-6)
    np.testing.assert_allclose(fine.qdd_rad_s2[:, 0], 0.8 * 60 * s * (1 - s) * (1 - 2 * s) / 0.25, atol=1e-4)


def edit_on_disk(path: Path) -> None:
    data = json.loads(path.read_text())
    data["points"][100]["positions"][0] += 0.1
    path.write_text(json.dumps(data))


def other_arm(motion: Motion) -> None:
    motion.robot.file_sha256 = "0" * 64


def other_joints(motion: Motion) -> None:
    motion.joint_names = ["joint_1", "joint_3", "joint_2"]


def not_at_rest(motion: Motion) -> None:
    motion.points = motion.points[:150]


def still_moving(motion: Motion) -> None:
    motion.points[-1].velocities[1] = 0.001


def jump(motion: Motion) -> None:
    motion.points[100].positions[1] += 0.05


def backwards(motion: Motion) -> None:
    motion.points[3].time_from_start.nanosec = 1


def in_degrees(motion: Motion) -> None:
    motion.units = motion.units | {"angle": "deg"}


def wide_tolerance(motion: Motion) -> None:
    motion.start.tolerance_rad[2] = 10.0


def other_start(motion: Motion) -> None:
    motion.start.positions_rad[0] += 0.001


@pytest.mark.parametrize(
    ("spoil", "code"),
    [
        (in_degrees, "SC-R001.*units.*deg"),
        (wide_tolerance, r"SC-X004.*start\.tolerance_rad"),
        (other_start, r"SC-X004.*start\.positions_rad"),
        (other_arm, "SC-X004.*was planned for"),
        (other_joints, "SC-X004.*joint_names"),
        (not_at_rest, "SC-X004.*at rest"),
        (still_moving, "SC-X004.*at rest"),
        (jump, "SC-X004.*points"),
        (backwards, "SC-X004.*rising times"),
    ],
)
def test_a_motion_that_does_not_fit_is_refused(
    arm: PlanarArm, motion: Motion, tmp_path: Path, spoil: Callable[[Motion], None], code: str
) -> None:
    spoil(motion)
    motion.write(tmp_path / "planned.json")
    assert_refused(tmp_path, arm, PerfectArm(), code)


def test_an_edited_motion_is_refused(arm: PlanarArm, motion: Motion, tmp_path: Path) -> None:
    motion.write(tmp_path / "planned.json")
    edit_on_disk(tmp_path / "planned.json")
    assert_refused(tmp_path, arm, PerfectArm(), "SC-R001")


@pytest.mark.parametrize(
    ("by", "duration_s", "what"),
    [(2.0, 0.3, "velocity"), (0.9, 0.2, "acceleration"), (2.45, 1.2, "position")],
)
def test_a_motion_beyond_the_limits_is_refused(
    arm: PlanarArm, tmp_path: Path, by: float, duration_s: float, what: str
) -> None:
    make_motion(arm, by, duration_s).write(tmp_path / "planned.json")
    assert_refused(tmp_path, arm, PerfectArm(), rf"SC-X004.*{what}")


def test_an_arm_that_is_elsewhere_or_moves_is_refused(arm: PlanarArm, motion: Motion, tmp_path: Path) -> None:
    motion.write(tmp_path / "planned.json")
    assert_refused(tmp_path, arm, PerfectArm(START + np.array([0.0, 0.02, 0.0])), "SC-X006.*joint_2")
    assert_refused(tmp_path, arm, PerfectArm(speed_rad_s=0.1), "SC-X007")
    away = PerfectArm(START + 0.5)
    play(tmp_path / "planned.json", arm, away, tmp_path / "moved", move_to_start=True)
    assert len(away.played) == 1


def test_an_existing_trial_is_never_overwritten(arm: PlanarArm, motion: Motion, tmp_path: Path) -> None:
    motion.write(tmp_path / "planned.json")
    play(tmp_path / "planned.json", arm, PerfectArm(), tmp_path / "trial-01")
    driver = PerfectArm()
    with pytest.raises(StrandcastError, match="SC-X010"):
        play(tmp_path / "planned.json", arm, driver, tmp_path / "trial-01")
    assert not driver.played


def test_an_aborted_throw_leaves_an_incomplete_run(arm: PlanarArm, motion: Motion, tmp_path: Path) -> None:
    motion.write(tmp_path / "planned.json")
    with pytest.raises(StrandcastError, match="SC-X011"):
        play(tmp_path / "planned.json", arm, PerfectArm(status="aborted"), tmp_path / "trial-01")
    assert not Run.read(tmp_path / "trial-01" / "run.json").complete
    with pytest.raises(StrandcastError, match="not complete"):
        read_run(tmp_path / "trial-01")


@pytest.mark.parametrize(
    ("lost", "reason"),
    [
        (slice(-20, None), "ends less than 0.5 s after"),
        (slice(0, 260), "begins 20 ms after"),
        (slice(400, 406), "a gap of 14 ms"),
        (slice(0, 750), "it has no rows"),
    ],
)
def test_an_incomplete_log_is_a_failed_run(
    arm: PlanarArm, motion: Motion, tmp_path: Path, lost: slice, reason: str
) -> None:
    motion.write(tmp_path / "planned.json")
    driver = PerfectArm()
    driver.lose = lost
    with pytest.raises(StrandcastError, match=f"SC-X011.*{reason}") as caught:
        play(tmp_path / "planned.json", arm, driver, tmp_path / "trial-01")
    assert caught.value.exit_code == LOG_INCOMPLETE
    run = Run.read(tmp_path / "trial-01" / "run.json")
    assert (run.complete, run.status) == (False, "incomplete")


def test_a_short_gap_is_only_reported(arm: PlanarArm, motion: Motion, tmp_path: Path) -> None:
    motion.write(tmp_path / "planned.json")
    driver = PerfectArm()
    driver.lose = slice(400, 404)
    run = play(tmp_path / "planned.json", arm, driver, tmp_path / "trial-01")
    assert run.complete
    assert run.warnings == ["1 gaps and 0 duplicates in the joint log"]


@pytest.mark.parametrize("call", ["connect", "state", "move_to_start"])
def test_a_driver_that_fails_before_the_throw_is_reported_as_such(
    arm: PlanarArm, motion: Motion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    motion.write(tmp_path / "planned.json")
    driver = PerfectArm()
    monkeypatch.setattr(driver, call, failing)
    with pytest.raises(StrandcastError, match=r"SC-X011.*before the throw.*no carrier") as caught:
        play(tmp_path / "planned.json", arm, driver, tmp_path / "trial-01", move_to_start=True)
    assert caught.value.exit_code == ENVIRONMENT
    assert (driver.stopped, driver.played) == (1, [])


def test_a_driver_that_fails_to_stop_loses_neither_the_log_nor_an_earlier_error(
    arm: PlanarArm, motion: Motion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion.write(tmp_path / "planned.json")
    driver = PerfectArm()
    monkeypatch.setattr(driver, "stop", failing)
    with pytest.raises(StrandcastError, match=r"SC-X011.*at its end.*no carrier") as caught:
        play(tmp_path / "planned.json", arm, driver, tmp_path / "trial-01")
    assert caught.value.exit_code == ENVIRONMENT
    assert read_run(tmp_path / "trial-01")[0].complete
    away = PerfectArm(START + 0.5)
    monkeypatch.setattr(away, "stop", failing)
    with pytest.raises(StrandcastError, match="SC-X006"):
        play(tmp_path / "planned.json", arm, away, tmp_path / "trial-02")


def failing(*given: object) -> None:
    raise RuntimeError("no carrier")


def test_a_log_without_commands_is_complete_but_one_without_positions_is_not(
    arm: PlanarArm, motion: Motion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion.write(tmp_path / "planned.json")
    driver = PerfectArm()
    original = driver.play

    def forgetful(command: JointTrajectory, folder: Path) -> Recording:
        recording = original(command, folder)
        recording.log.q_cmd_rad[:] = np.nan
        if folder.name == "trial-02":
            recording.log.q_rad[300, 1] = np.nan
        return recording

    monkeypatch.setattr(driver, "play", forgetful)
    run = play(tmp_path / "planned.json", arm, driver, tmp_path / "trial-01")
    assert (run.complete, run.following) == (True, None)
    with pytest.raises(StrandcastError, match=r"SC-X011.*missing times or joint positions") as caught:
        play(tmp_path / "planned.json", arm, driver, tmp_path / "trial-02")
    assert caught.value.exit_code == LOG_INCOMPLETE


def assert_refused(folder: Path, arm: PlanarArm, driver: PerfectArm, code: str) -> None:
    with pytest.raises(StrandcastError, match=code) as caught:
        play(folder / "planned.json", arm, driver, folder / "trial-01")
    assert caught.value.exit_code == REFUSED
    assert "nothing was sent" in str(caught.value.message())
    assert not driver.played
    assert not (folder / "trial-01").exists()


class FillingArm(PerfectArm):
    """While it moves, something else fills the disk."""

    def play(self, command: JointTrajectory, folder: Path) -> Recording:
        with (folder / "other").open("wb", buffering=0) as other, suppress(OSError):
            while True:
                other.write(bytes(4096))
        return super().play(command, folder)


def test_the_logs_space_is_kept_while_the_arm_moves(
    arm: PlanarArm, motion: Motion, tmp_path: Path, small_disk: Path
) -> None:
    motion.write(tmp_path / "planned.json")
    play(tmp_path / "planned.json", arm, FillingArm(), small_disk / "trial-01")
    run, log = read_run(small_disk / "trial-01")
    assert run.complete
    assert len(log.time_s) == 751


def test_a_log_without_space_is_refused_before_the_arm_moves(
    arm: PlanarArm, motion: Motion, tmp_path: Path
) -> None:
    motion.write(tmp_path / "planned.json")
    preflight = run_preflight(
        tmp_path / "planned.json", arm, PerfectArm(), tmp_path / "trial-01", PlayOptions()
    )
    driver = PerfectArm()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, before[1]))
    try:
        with pytest.raises(StrandcastError, match=r"SC-W002.*needs up to .* MB.*File too large") as caught:
            play_checked(preflight, driver, preflight.short_hash, VirtualClock())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert caught.value.exit_code == REFUSED
    assert not driver.played
    assert not (tmp_path / "trial-01").exists()


@pytest.mark.parametrize("turned_rad", [0.0, 0.8], ids=["throw's joints", "the base too"])
def test_the_way_to_the_start_keeps_to_the_limits_of_the_whole_arm(turned_rad: float) -> None:
    arm = load_arm(ROOT / "config/arms/ur5e-example.toml")
    tool_m_s = 0.1
    limits = np.where(arm.limits.whole_arm_limited, arm.limits.whole_arm, np.inf)
    limits[:2] = tool_m_s
    slow_arm = replace(arm, limits=replace(arm.limits, whole_arm=limits))
    names = arm.all_joints
    q_to = np.array([arm.held.get(name, -1.0) for name in names])
    q_from = q_to + np.where([name in arm.joints for name in names], 0.4, 0.0)
    q_from[0] -= turned_rad
    usual, slow = (slow_trajectory(one, names, q_from, q_to, 100.0) for one in (arm, slow_arm))
    usual_m_s, slow_m_s = flange_speed_m_s(arm, usual), flange_speed_m_s(arm, slow)
    assert usual_m_s > 1.5 * tool_m_s
    assert 0.3 * tool_m_s < slow_m_s <= tool_m_s
    np.testing.assert_allclose(slow.q_rad[[0, -1]], [q_from, q_to], atol=1e-9)


def flange_speed_m_s(arm: Arm, path: JointTrajectory) -> float:
    """Return the greatest speed of the clamp's link on a path of all joints."""
    data, places = mujoco.MjData(arm.model()), []
    for angles in path.q_rad:
        data.qpos[:] = angles
        mujoco.mj_kinematics(arm.model(), data)
        places.append(data.body(arm.clamp.link).xpos.copy())
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(path.time_s)
    return float(speeds.max())


def test_an_arm_that_is_slow_moves_to_the_start_all_the_same(
    arm: PlanarArm, motion: Motion, tmp_path: Path
) -> None:
    limits = np.full_like(arm.limits.whole_arm, np.inf)
    limits[:2] = 0.1
    motion.write(tmp_path / "planned.json")
    ready = run_preflight(
        tmp_path / "planned.json", arm, PerfectArm(), tmp_path / "trial-01", PlayOptions(move_to_start=True)
    )
    slow_arm = replace(arm, limits=replace(arm.limits, whole_arm=limits))
    away = PerfectArm(START + 0.5)
    play_checked(replace(ready, arm=slow_arm), away, ready.short_hash, VirtualClock())
    assert len(away.played) == 1
