"""`strandcast play`: dry by default, live only when confirmed."""

import io
import sys
from pathlib import Path

import pytest

from strandcast.arm.load import load_arm
from strandcast.errors import REFUSED, StrandcastError
from strandcast.executor.preflight import PlayOptions
from strandcast.records.joint_log import Run
from strandcast.stages import play as stage

from .test_play import PerfectArm, make_motion

ROOT = Path(__file__).parents[2]
ARM = ROOT / "config" / "arms" / "planar3.toml"


class Keyboard(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> PerfectArm:
    driver = PerfectArm()
    monkeypatch.setattr(stage, "driver_of_arm", lambda arm, motion: driver)
    monkeypatch.chdir(tmp_path)
    make_motion(load_arm(ARM).planar()).write(tmp_path / "motion.json")
    return driver


def play(said: list[str], **given: object) -> Run | None:
    usual = {"options": PlayOptions(), "hanging_m": None, "live": False, "confirm": None}
    return stage.run(Path("motion.json"), ARM, Path("run"), **(usual | given), say=said.append)


def test_a_dry_run_sends_nothing_and_prints_the_hash(driver: PerfectArm) -> None:
    said: list[str] = []
    assert play(said) is None
    assert not driver.played
    assert driver.stopped == 0
    short_hash = said[-1].split()[-1]
    assert short_hash in said[0]
    assert not Path("run").exists()
    assert play(said, confirm=short_hash).complete
    assert len(driver.played) == 1


def test_a_live_run_requires_the_typed_hash(driver: PerfectArm, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    play(said)
    short_hash = said[-1].split()[-1]
    for typed in ("y\n", "\n", ""):
        monkeypatch.setattr(sys, "stdin", Keyboard(typed))
        with pytest.raises(StrandcastError, match="SC-X012"):
            play(said, live=True)
    assert not driver.played
    monkeypatch.setattr(sys, "stdin", Keyboard(short_hash + "\n"))
    assert play(said, live=True).complete


def test_a_live_run_without_a_keyboard_is_refused(
    driver: PerfectArm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("y\n"))
    with pytest.raises(StrandcastError, match=r"SC-X012.*there is no keyboard") as caught:
        play([], live=True)
    assert caught.value.exit_code == REFUSED
    assert not driver.played


def test_an_arm_may_be_given_by_its_name(driver: PerfectArm, project_root: Path) -> None:
    (Path("config")).symlink_to(project_root / "config")
    Path("Snakefile").touch()
    said: list[str] = []
    stage.run(
        Path("motion.json"), Path("planar3"), Path("run"), PlayOptions(), None, False, None, said.append
    )
    assert "on planar3" in said[0]
    with pytest.raises(StrandcastError, match="planar4"):
        stage.run(Path("motion.json"), Path("planar4"), Path("run"), PlayOptions(), None, False, None)


def test_a_real_arm_needs_the_length_that_hangs_from_it(driver: PerfectArm) -> None:
    driver.address = "192.0.2.7"
    with pytest.raises(StrandcastError, match=r"SC-W020.*no experiment 'e'"):
        play([])
    said: list[str] = []
    play(said, hanging_m=0.3)
    assert any("with 0.30 m of string" in line for line in said)
