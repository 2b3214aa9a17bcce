"""Fixtures that all tests share."""

import os
import shutil
from pathlib import Path

import pytest

from strandcast.arm.load import clamp_frame, load_arm
from strandcast.arm.spatial import SpatialArm, load_spatial_arm

# Small matrices: more threads only spin, and take the other core's time (the workflow's jobs have one too).
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

ROOT = Path(__file__).resolve().parent.parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run files with slow tests first: the quick ones at the end let no worker wait long for another."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


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
    along = clamp_frame(load_arm(source.with_suffix(".toml")))[1][0]
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
    return load_spatial_arm(folder / "planar3.toml")
