"""A driver from a package outside strandcast is found, checked and plays a motion."""

import sys
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import load_arm
from strandcast.errors import StrandcastError
from strandcast.executor.drivers.registry import DRIVERS, driver_of_arm
from strandcast.executor.play import play
from strandcast.executor.preflight import run_preflight
from strandcast.records.joint_log import read_run
from strandcast.records.motion import Motion

from .test_play import make_motion
from .virtual import VirtualClock

PAGE = "docs/extending/arm-driver.md"


def python_block(page: Path) -> str:
    """Return the first Python example of a page."""
    return page.read_text().split("```python\n")[1].split("```")[0]


@pytest.fixture
def toy_arm(project_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Install the page's driver as a package of its own; return the file of an arm that names it."""
    site = tmp_path / "site"
    info = site / "toy_arm-1.0.dist-info"
    info.mkdir(parents=True)
    (site / "toy_arm.py").write_text(python_block(project_root / PAGE))
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: toy-arm\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[strandcast.drivers]\ntoy = toy_arm:toy_driver\n")
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.delitem(sys.modules, "toy_arm", raising=False)
    monkeypatch.setattr(DRIVERS, "_entries", {})
    arms = project_root / "config" / "arms"
    text = (arms / "planar3.toml").read_text().replace('name = "lab"', 'name = "toy"')
    (tmp_path / "planar3.urdf").write_bytes((arms / "planar3.urdf").read_bytes())
    (tmp_path / "arm.toml").write_text(text)
    return tmp_path / "arm.toml"


def test_the_example_of_the_page_plays_a_motion(toy_arm: Path, tmp_path: Path) -> None:
    arm = load_arm(toy_arm).planar()
    make_motion(arm).write(tmp_path / "planned.json")
    driver = driver_of_arm(arm, Motion.read(tmp_path / "planned.json"))
    assert (driver.name, driver.streams) == ("toy", False)
    clock = VirtualClock()
    preflight = run_preflight(tmp_path / "planned.json", arm, driver, tmp_path / "trial-01", clock=clock)
    driver.move_to_start(preflight.motion.trajectory().q_rad[0])
    assert play(preflight, driver, preflight.short_hash, clock).complete
    run, log = read_run(tmp_path / "trial-01")
    assert (run.driver, run.status) == ("toy", "ok")
    moving = np.isfinite(log.since_start_s)
    expected = preflight.motion.trajectory().at(log.since_start_s[moving])
    np.testing.assert_allclose(log.q_rad[moving], expected.q_rad, atol=1e-9)


def test_the_checks_of_the_player_hold_for_a_driver_from_outside(toy_arm: Path, tmp_path: Path) -> None:
    arm = load_arm(toy_arm).planar()
    make_motion(arm).write(tmp_path / "planned.json")
    driver = driver_of_arm(arm, Motion.read(tmp_path / "planned.json"))
    clock = VirtualClock()
    preflight = run_preflight(tmp_path / "planned.json", arm, driver, tmp_path / "trial-01", clock=clock)
    driver.move_to_start(preflight.motion.trajectory().q_rad[0] + 0.1)
    with pytest.raises(StrandcastError, match="SC-X006"):
        play(preflight, driver, preflight.short_hash, clock)
    assert not (tmp_path / "trial-01").exists()
