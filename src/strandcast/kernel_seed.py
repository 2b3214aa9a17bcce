"""Machine code that comes with a wheel: the first run compiles nothing.

A seed fits one version of Python, one level of processors (`cpu_level`), the code of all kernels and the
versions of the compiler. All else is compiled, for the same level: the machine code is the same.
"""

import json
import sys
from contextlib import suppress
from functools import cache
from itertools import takewhile
from pathlib import Path

# hashlib, tempfile and importlib.metadata are imported on use: every process of this package comes by here,
# and most find their kernels.

SEEDS = Path(__file__).with_name("shipped") / "kernels"
MANIFEST = "manifest.json"
COMPILERS = ("llvmlite", "numba", "numpy")
# What processors of a level can do, in Linux's words; a level includes those below it.
LEVELS = {
    "x86-64-v3": {"avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe"},
    "x86-64-v4": {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"},
}


@cache
def cpu_levels() -> tuple[str, ...]:
    """Return the levels of x86-64 that this processor supports, the highest last; none on other systems."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return ()
    flags = next((set(line.split(":")[1].split()) for line in lines if line.startswith("flags")), set())
    return tuple(takewhile(lambda level: LEVELS[level] <= flags, LEVELS))


def seed_name(level: str) -> str:
    """Return the name of the seed of this Python for a level."""
    return f"{sys.implementation.cache_tag}-{level}"


def plant(folder: Path, level: str, kernels_sha256: str) -> None:
    """Make the folder of compiled kernels from the seed, if there is one that fits and is undamaged."""
    seed = SEEDS / seed_name(level)
    if folder.exists() or not seed.is_dir():
        return
    import tempfile

    with suppress(OSError, ValueError, KeyError):
        manifest = json.loads((seed / MANIFEST).read_bytes())
        if manifest["made_from"] != made_from(kernels_sha256):
            return
        # numba unpickles these files: each is checked before any is used.
        contents = {name: (seed / name).read_bytes() for name in manifest["files"]}
        if any(sha256(content) != manifest["files"][name] for name, content in contents.items()):
            return
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent, ignore_cleanup_errors=True) as temporary:
            planted = Path(temporary, folder.name)
            for name, content in contents.items():
                (planted / name).parent.mkdir(parents=True, exist_ok=True)
                (planted / name).write_bytes(content)
            planted.rename(folder)  # fails if another process was first


def made_from(kernels_sha256: str) -> dict[str, str]:
    """Return what a seed must have been made from to be used here."""
    from importlib.metadata import version

    return {"kernels": kernels_sha256} | {name: version(name) for name in COMPILERS}


def sha256(content: bytes) -> str:
    """Return the hash of a file's content."""
    import hashlib

    return hashlib.sha256(content).hexdigest()
