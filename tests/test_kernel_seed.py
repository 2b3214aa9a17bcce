"""A wheel with a seed of compiled kernels is installed, and compiles nothing."""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

from strandcast import kernel_seed
from strandcast.kernel_cache import kernels_sha256
from strandcast.kernel_seed import MANIFEST, cpu_levels, plant
from strandcast_studies.kernel_seeds import write_seed

from .test_kernel_cache import USE

needs_level = pytest.mark.skipif(not cpu_levels(), reason="this processor has no level of x86-64 with seeds")


@pytest.fixture(scope="module")
def seeds(tmp_path_factory) -> Path:
    """Return a folder with a seed of one kernel for this processor's level."""
    out = tmp_path_factory.mktemp("seeds")
    write_seed(out, cpu_levels()[-1], USE)
    return out


@pytest.mark.thorough
@needs_level
def test_an_installed_wheel_with_a_seed_compiles_nothing(tmp_path, project_root, seeds):
    sources = tmp_path / "sources"
    for name in ("src", "workflow", "config"):
        shutil.copytree(project_root / name, sources / name, ignore=shutil.ignore_patterns("*.egg-info"))
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(project_root / name, sources)
    shutil.copytree(seeds, sources / "build" / "kernels")
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*build, "--wheel-dir", str(tmp_path), str(sources)], check=True)
    (wheel,) = tmp_path.glob("*.whl")
    venv.create(tmp_path / "venv", symlinks=True)
    python = tmp_path / "venv" / "bin" / "python"
    place = Path(sysconfig.get_path("purelib", vars={"base": str(tmp_path / "venv")}))
    install = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-deps",
        "--target",
        str(place),
        str(wheel),
    ]
    subprocess.run(install, check=True)
    (place / "libraries.pth").write_text(sysconfig.get_path("purelib") + "\n")

    def hits_and_misses(home: str) -> str:
        clean = {
            name: value
            for name, value in os.environ.items()
            if not name.startswith(("NUMBA_", "PYTHON", "XDG_"))
        }
        (tmp_path / home).mkdir()
        environment = clean | {"HOME": str(tmp_path / home)}
        done = subprocess.run(
            [python, "-c", USE], env=environment, cwd=tmp_path, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    assert hits_and_misses("first") == "1 0"
    kernel = next((place / "strandcast" / "shipped" / "kernels").rglob("*.nbc"))
    kernel.write_bytes(kernel.read_bytes() + b"\0")
    assert hits_and_misses("second") == "0 1"


@needs_level
def test_only_a_seed_that_fits_and_is_whole_is_planted(tmp_path, monkeypatch, seeds):
    level = cpu_levels()[-1]
    seed = tmp_path / "seeds" / kernel_seed.seed_name(level)
    shutil.copytree(seeds / seed.name, seed)
    monkeypatch.setattr(kernel_seed, "SEEDS", seed.parent)

    def planted(kernels: str = kernels_sha256()) -> set[Path]:
        folder = tmp_path / "kernels"
        shutil.rmtree(folder, ignore_errors=True)
        plant(folder, level, kernels)
        return {path.relative_to(folder) for path in folder.rglob("*.nb*")}

    assert planted() == {path.relative_to(seed) for path in seed.rglob("*.nb*")} != set()
    assert planted("other kernels") == set()
    manifest = (seed / MANIFEST).read_text()
    (seed / MANIFEST).write_text(manifest.replace('"numba": "', '"numba": "9'))
    assert planted() == set()
    (seed / MANIFEST).write_text(manifest[:-20])
    assert planted() == set()
    (seed / MANIFEST).write_text(manifest)
    (tmp_path / "kernels").mkdir(exist_ok=True)
    plant(tmp_path / "kernels", level, kernels_sha256())
    assert list((tmp_path / "kernels").iterdir()) == []  # what this user compiled is never replaced
    next(seed.rglob("*.nbi")).unlink()
    assert planted() == set()


@pytest.mark.parametrize(
    ("flags", "levels"),
    [
        ("fpu sse2", ()),
        ("avx avx2 bmi1 bmi2 f16c fma abm movbe", ("x86-64-v3",)),
        ("avx avx2 bmi1 bmi2 f16c fma abm movbe avx512f", ("x86-64-v3",)),
        (
            "avx avx2 bmi1 bmi2 f16c fma abm movbe avx512f avx512bw avx512cd avx512dq avx512vl",
            ("x86-64-v3", "x86-64-v4"),
        ),
        ("avx512f avx512bw avx512cd avx512dq avx512vl", ()),  # as some virtual machines say
    ],
)
def test_a_level_needs_all_that_it_and_those_below_contain(monkeypatch, flags, levels):
    monkeypatch.setattr(Path, "read_text", lambda self: f"processor : 0\nflags\t\t: {flags}\n")
    assert cpu_levels.__wrapped__() == levels


TARGET = """
import os, strandcast
from numba.core import config
from strandcast.dynamics.vectors import register_bits
print(os.environ.get("NUMBA_CPU_NAME"), config.CPU_NAME, register_bits())
"""


@needs_level
@pytest.mark.parametrize(
    ("asked", "chosen"), [(None, -1), ("x86-64-v3", 0), ("x86-64-v4", -1)], ids=["none", "lower", "highest"]
)
def test_a_lower_level_can_be_chosen_and_a_higher_one_is_not_inherited(asked, chosen):
    """A cluster passes the environment of the node that one types on to those that compute."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    environment = clean if asked is None else clean | {"NUMBA_CPU_NAME": asked, "NUMBA_CPU_FEATURES": ""}
    done = subprocess.run([sys.executable, "-c", TARGET], env=environment, capture_output=True, text=True)
    level = cpu_levels()[chosen]
    bits = {"x86-64-v3": "256", "x86-64-v4": "512"}[level]
    assert done.stdout.split() == [level, level, bits], done.stderr
