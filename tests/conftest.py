"""Fixtures that all tests share, and what a run of the tests says at its end."""

import gc
import os
import shutil
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock
from tests.faults.small import make_whole
from tests.report.chromium import Browser, chromium
from tests.video.here import decode_here, probe_here
from threadpoolctl import threadpool_limits

from strandcast.arm.load import SpatialArm, clamp_frame, load_arm

# Small matrices: more threads only spin, and take the other core's time (the workflow's jobs have one too).
# What is loaded later, and in other processes, reads the variable; numpy was loaded by the imports above.
threadpool_limits(int(os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")))

ROOT = Path(__file__).resolve().parent.parent


LEFT_OUT = "left out"  # how many tests a worker has not run, in what it sends
# Each compiles many kernels: they begin the run, each on one worker, before other files need the same.
COMPILING = ("tracking/test_led.py", "estimation/test_cable_fit.py", "planning/test_plan.py")
# Rooms with files that take long: early, so that no worker waits long for another at the end.
LONG = ("workflow", "stages", "report", "estimation", "planning", "tracking")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort files by when they should begin."""

    def begins(item: pytest.Item) -> int:
        room = item.path.parent.name
        name = f"{room}/{item.path.name}"
        if name in COMPILING:
            return COMPILING.index(name)
        # Pages need no kernel: made while a worker compiles for planning, none is compiled twice.
        return 10 if room == "report" else 11 if room in LONG else 12

    items.sort(key=begins)


class LeftOut:
    """Counts the tests that are left out, in this process or in the workers, and reports them."""

    def __init__(self, config: pytest.Config) -> None:
        self.config, self.count = config, 0

    def pytest_deselected(self, items: list[pytest.Item]) -> None:
        self.count += sum(item.get_closest_marker("thorough") is not None for item in items)

    def pytest_sessionfinish(self) -> None:
        if hasattr(self.config, "workeroutput"):
            self.config.workeroutput[LEFT_OUT] = self.count

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        self.count = max(self.count, getattr(node, "workeroutput", {}).get(LEFT_OUT, 0))

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Say in a line each why tests were skipped, and what was left out."""
        reasons = Counter(report.longrepr[2] for report in terminalreporter.stats.get("skipped", ()))
        for reason, count in reasons.most_common():
            terminalreporter.line(f"{count} skipped: {reason.removeprefix('Skipped: ')}")
        if self.count:
            terminalreporter.line(
                f"{self.count} left out: `make test-all` adds every command of the documents, all proofs, "
                "kills, refused calls, notebooks and long searches; half an hour on two cores"
            )


def pytest_configure(config: pytest.Config) -> None:
    """Add the report of what was left out."""
    config.pluginmanager.register(LeftOut(config))


@pytest.fixture(autouse=True, scope="module")
def frozen() -> None:
    """Spare what earlier files left from collections: compilers leave millions of objects."""
    gc.collect(1)
    gc.freeze()


# Files that test the process which decodes a video; to start one takes longer than its work.
ISOLATED = {
    *("test_hosts.py", "test_hostile_pictures.py", "test_hostile_video.py"),
    *("test_isolated.py", "test_native.py", "test_outside_reader.py"),
}


@pytest.fixture(autouse=True)
def decoding(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Decode videos in the tests' own process; commands that tests start do it as always."""
    if request.path.name not in ISOLATED:
        monkeypatch.setattr("strandcast.video.reader.decode_isolated", decode_here)
        monkeypatch.setattr("strandcast.video.ingest.probe_isolated", probe_here)


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a project with the small lab experiment, run to its end once for all workers; change copies."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent  # the workers'
    root, done = folder / "finished", folder / "finished.done"
    with FileLock(folder / "finished.lock"):
        if not done.exists():
            shutil.rmtree(root, ignore_errors=True)
            make_whole(root)
            done.touch()
    return root


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """Return the one browser of this worker; tests open pages of their own."""
    with chromium(tmp_path_factory.mktemp("browser")) as running:
        yield running


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Return the folder of real measured data; the test is skipped where there is none."""
    folder = os.environ.get("STRANDCAST_REAL_DATA")
    if not folder or not Path(folder).is_dir():
        pytest.skip("STRANDCAST_REAL_DATA names no folder: real measured data are not on this machine")
    return Path(folder)


@pytest.fixture(scope="session")
def project_root() -> Path:
    """Return the repository's root."""
    return ROOT


@pytest.fixture(scope="session")
def planar_arm_in_space(project_root: Path, tmp_path_factory: pytest.TempPathFactory) -> SpatialArm:
    """Return planar3 without its plane: an arm in space, x to the right, z upwards."""
    source, folder = project_root / "config/arms/planar3", tmp_path_factory.mktemp("planar3")
    along = clamp_frame(load_arm(source.with_suffix(".toml")).planar())[1][0]
    keep, skip = [], False
    for line in source.with_suffix(".toml").read_text(encoding="utf-8").splitlines():
        skip = line.startswith(("[markers]", "[[markers")) if line.startswith("[") else skip
        if skip or line.startswith(("plane_x", "plane_y", "angle_rad")):
            continue
        if line.startswith("offset_m"):
            line = f"offset_m = [0.0, 0.0, 0.0]\ndirection = {along.tolist()}"
        if line.startswith("y_m"):
            line = "y_m = [-1.35, 1.35]\nz_m = [-1.00, 1.35]"
        keep.append(line)
    (folder / "planar3.toml").write_text("\n".join(keep), encoding="utf-8")
    shutil.copyfile(source.with_suffix(".urdf"), folder / "planar3.urdf")
    return load_arm(folder / "planar3.toml").spatial()
