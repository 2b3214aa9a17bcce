"""The folder of compiled kernels.

numba checks only a kernel's own file to decide whether its machine code is current. But kernels call each
other across files, and numba compiles the constants that they import as literals: after an update, old
machine code could run from the cache. So the cache's folder is named by a hash of all code that machine
code depends on: the files with kernels and the modules from which they import constants. Comments and
docstrings do not count, nor where the package lies (`strandcast.kernel_locator`).
"""

import os
import stat
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from zlib import crc32

from strandcast.kernel_seed import LEVELS, cpu_levels, plant, seed_name
from strandcast.user_cache import cache_folder, cached, can_be_written, keep

# What only the search for a folder needs is imported on use: most processes inherit NUMBA_CACHE_DIR.

PACKAGE = Path(__file__).resolve().parent
MARK = b"njit"
COMPILED_AHEAD = "compiled-ahead"  # a file in the folder, once `strandcast.kernels_ahead` has filled it
# Kernels outside this package are kept as numba does it by itself.
LOCATORS = "strandcast.kernel_locator.KernelLocator,UserProvidedCacheLocator"


def use_own_cache() -> None:
    """Set numba's cache to the folder of these kernels, unless the user has set NUMBA_CACHE_DIR.

    A job of a cluster gets the variable from the computer that submitted it; that folder may not exist here.
    """
    level = _target()
    given = os.environ.get("NUMBA_CACHE_DIR")
    if not given or not can_be_written(Path(given)):
        folder = _writable_folder()
        if folder is not None:
            own = folder / f"{kernels_sha256()[:16]}-{seed_name(level)}"
            plant(own, level, kernels_sha256())
            os.environ["NUMBA_CACHE_DIR"] = str(own)
    os.environ.setdefault("NUMBA_CACHE_LOCATOR_CLASSES", LOCATORS)


def _target() -> str:
    """Set and return what numba compiles for: the processor's level, unless the user has set NUMBA_CPU_NAME.

    For its level, not for its model: machine code can be passed on, numbers are the same on more computers,
    and speed is within 2 % (docs/decisions/0010-determinism.md).
    """
    if os.environ.get("NUMBA_CPU_NAME") in {*LEVELS} - {*cpu_levels()}:  # a cluster's login node set it
        del os.environ["NUMBA_CPU_NAME"]
    if cpu_levels() and "NUMBA_CPU_NAME" not in os.environ:
        os.environ |= {"NUMBA_CPU_NAME": cpu_levels()[-1], "NUMBA_CPU_FEATURES": ""}
    return os.environ.get("NUMBA_CPU_NAME", "host")


@cache
def kernels_sha256() -> str:
    """Return the hash of the code that compiled kernels depend on.

    Finding it takes a tenth of a second, so it is kept until a file of this package is written.
    """
    name, written = f"kernels-of-{crc32(os.fsencode(PACKAGE)):08x}.txt", "\n".join(sorted(_written(PACKAGE)))
    known, _, before = cached(name).partition("\n")
    if before == written:
        return known
    found = _hashed()
    keep(name, f"{found}\n{written}")
    return found


def _written(folder: str | Path) -> Iterator[str]:
    """Yield, for each file of this package, its path, its size and when it was last changed."""
    for entry in os.scandir(folder):
        if entry.is_dir():
            yield from _written(entry.path)
        elif entry.name.endswith(".py"):
            stat = entry.stat()
            yield f"{entry.path[len(str(PACKAGE)) :]} {stat.st_size} {stat.st_ctime_ns}"


def _hashed() -> str:
    import hashlib

    from strandcast.source_code import code_of, file_of, save_codes

    kernels = {path for path in PACKAGE.rglob("*.py") if MARK in path.read_bytes()}
    modules = {module for path in kernels for module in _modules_of_constants(code_of(path).imports)}
    constants = {path for module in modules if (path := file_of(module)) is not None}
    digest = hashlib.sha256()
    for path in sorted(kernels | constants):
        digest.update(f"{path.relative_to(PACKAGE)}\0{code_of(path).sha256}".encode())
    save_codes()
    return digest.hexdigest()


def _modules_of_constants(imports: tuple[str, ...]) -> Iterator[str]:
    """Yield the modules of this package from which constants are imported."""
    for name in imports:
        module, _, constant = name.rpartition(".")
        if module.startswith(f"{PACKAGE.name}.") and constant.isupper():
            yield module


def _writable_folder() -> Path | None:
    """Return this user's folder of kernels: in the home folder, or else among the temporary files."""
    folder = cache_folder()
    if folder is not None:
        return folder / "kernels"
    import tempfile

    try:
        shared = Path(tempfile.gettempdir()) / f"strandcast-kernels-{os.getuid()}"
        shared.mkdir(mode=0o700, exist_ok=True)
        # numba runs the code that it finds there: a folder that others can write is not safe.
        found = shared.lstat()
        own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
        return shared if own else Path(tempfile.mkdtemp(prefix="strandcast-kernels-"))
    except OSError:
        return None
