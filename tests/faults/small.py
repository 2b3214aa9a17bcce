"""One small lab experiment, cheap enough to be made hundreds of times: its jobs, the hashes of its files."""

import os
import shutil
from pathlib import Path

from strandcast.records.files import sha256_file

PROJECT = Path(__file__).resolve().parents[2]
NAME = "small"
SETTINGS = """\
title: A small throw
string: {length_m: 0.30, weights: [{place_m: 0.30}]}
target_m: [0.50, 0.50]
max_trials: 1
seed: 3
workspace_m: {x_m: [-0.75, 1.25], y_m: [-0.32, 0.80]}
camera:
  plane:
    markers:
      - {id: 0, x_m: -0.65, y_m: 0.70}
      - {id: 2, x_m: 1.15, y_m: 0.70}
      - {id: 3, x_m: -0.65, y_m: -0.22}
      - {id: 5, x_m: 1.15, y_m: -0.22}
estimate: {evaluations: 100, ensemble: 2, profiles: false}
plan: {screening: 16, evaluations: 16, ensemble: 1, mesh_refinement: false}
lab:
  noise: 0.5
  camera: {width_px: 640, height_px: 360, frame_rate_hz: 100}
"""
# All jobs of the workflow, in an order that the rules allow: stage and trials.
JOBS: tuple[tuple[str, tuple[int, ...]], ...] = (
    ("lab_calibrate", ()),
    ("calibrate", ()),
    ("plan", (1,)),
    ("lab_throw", (1,)),
    ("ingest", (1,)),
    ("track", (1,)),
    ("reconstruct", (1,)),
    ("align", (1,)),
    ("score", (1,)),
    ("estimate", (1,)),
    ("plan", (2,)),
    ("report", (1,)),
    ("summary", (1,)),
)


def make_project(folder: Path) -> Path:
    """Make a project's root with the small experiment alone, and return it."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(PROJECT / "Snakefile", folder)
    shutil.copytree(PROJECT / "workflow", folder / "workflow")
    shutil.copytree(PROJECT / "config" / "arms", folder / "config" / "arms")
    (folder / "config" / "experiments").mkdir()
    (folder / "config" / "experiments" / f"{NAME}.yaml").write_text(SETTINGS)
    return folder


def arguments(stage: str, trials: tuple[int, ...]) -> list[str]:
    """Return the arguments of `strandcast` that run a job."""
    return [stage.replace("_", "-"), NAME, *map(str, trials)]


def environment(**variables: str) -> dict[str, str]:
    """Return the environment of a command that runs this checkout, without its settings of libraries."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("SNAKEMAKE", "STRANDCAST", "OPENBLAS", "OMP", "MKL"))
    }
    return kept | {"PYTHONPATH": str(PROJECT / "src")} | variables


def hashes(root: Path) -> dict[str, str]:
    """Return the hash of every raw file and result by its place, but not of logs and leases."""
    files = (path for top in ("data", "results") for path in (root / top).rglob("*") if path.is_file())
    wanted = (path for path in files if "logs" not in path.parts and not path.name.startswith(".lease"))
    return {path.relative_to(root).as_posix(): sha256_file(path) for path in wanted}
