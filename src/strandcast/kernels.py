"""Where compiled kernels are kept.

numba asks only a kernel's own file whether its machine code is still good, but kernels call each other across
files: after an update, old physics could run from the cache. So the cache's folder is named by the content of
all files with kernels, and numba is told before it is imported.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent
MARK = b"njit"


def use_own_cache() -> None:
    """Point numba to the cache of just these kernels, unless the user has set NUMBA_CACHE_DIR."""
    if "NUMBA_CACHE_DIR" not in os.environ:
        os.environ["NUMBA_CACHE_DIR"] = str(_writable_folder() / kernels_sha256()[:16])


def kernels_sha256() -> str:
    """Return the hash of all source files that hold kernels."""
    digest = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_bytes()
        if MARK in text:
            digest.update(str(path.relative_to(PACKAGE)).encode() + b"\0" + text)
    return digest.hexdigest()


def _writable_folder() -> Path:
    try:
        folder = Path.home() / ".cache" / "strandcast" / "kernels"
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK)
    except (OSError, RuntimeError):
        writable = False
    # numba reads what it finds there as code: a folder that others could have made is no place for it.
    return folder if writable else Path(tempfile.mkdtemp(prefix="strandcast-kernels-"))
