"""Errors of the operating system, of exhausted memory and of broken packages, in the form of all messages."""

import errno
import os
import resource
import tempfile
from pathlib import Path

from strandcast.errors import ENVIRONMENT, StrandcastError
from strandcast.packages import broken_package
from strandcast.records.files import NO_ROOM, free_bytes, in_bytes

# How libraries report exhausted memory, if not by a MemoryError.
NO_MEMORY = ("failed to map segment", "annot allocate memory", "nsufficient memory", "out of memory")
# Below this, libraries fail to load, each in its own words: 0.9 GiB of address space measured for `track`.
SMALL_BYTES = 1 << 30


def problem_of(error: Exception) -> StrandcastError | None:
    """Return an error of the host or of a broken package as one of ours; None for any other error."""
    text = f"{error}".splitlines()[0] if str(error) else type(error).__name__
    if _is_memory(error, text):
        return _too_little_memory(text)
    if "can't start new thread" in text or isinstance(error, BlockingIOError):
        what = f"the system starts no more processes or threads ({text})"
        fix = "raise the limit of processes (`ulimit -u`, the cluster's), or end other programs"
        return StrandcastError("SC-W004", what, fix=fix, exit_code=ENVIRONMENT)
    if "cannot cache function" in text:  # numba's words
        what = "there is no folder for compiled code that can be written"
        fix = "set TMPDIR or NUMBA_CACHE_DIR to a folder that can be written"
        return StrandcastError("SC-W002", what, fix=fix, exit_code=ENVIRONMENT)
    if isinstance(error, OSError):
        return _refused(error)
    broken = broken_package(error)
    if broken is not None:
        return _too_little_memory(text) if _is_memory(ImportError(), broken.what) else broken
    if isinstance(error, ModuleNotFoundError) and not str(error.name).startswith("strandcast"):
        what = f"the package {error.name} is not installed (a robot's computer may have the player's alone)"
        fix = "install all packages: pip install strandcast"
        return StrandcastError("SC-W012", what, fix=fix, exit_code=ENVIRONMENT)
    return None


def _is_memory(error: Exception, text: str) -> bool:
    if isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM:
        return True
    allowed = resource.getrlimit(resource.RLIMIT_AS)[0]
    small = allowed != resource.RLIM_INFINITY and allowed < SMALL_BYTES
    not_loaded = isinstance(error, ImportError) or "shared object" in text
    return any(words in text for words in NO_MEMORY) or (small and not_loaded)


def _too_little_memory(text: str) -> StrandcastError:
    allowed = resource.getrlimit(resource.RLIMIT_AS)[0]
    limit = "" if allowed == resource.RLIM_INFINITY else f"; `ulimit -v` allows {in_bytes(allowed)}"
    what = f"there is too little memory ({text}{limit})"
    fix = "use fewer cores (`--cores 1`), end other programs, or allow more memory (`ulimit -v`)"
    return StrandcastError("SC-W004", what, fix=fix, exit_code=ENVIRONMENT)


def _refused(error: OSError) -> StrandcastError:
    what, file = str(error.strerror or error), error.filename
    if error.errno in NO_ROOM and file is None:  # say which disk is full
        cache = os.environ.get("NUMBA_CACHE_DIR")
        places = {Path(), Path(tempfile.gettempdir()), *([Path(cache)] if cache else [])}
        what += "; free: " + ", ".join(f"{in_bytes(free_bytes(each))} at {each}" for each in sorted(places))
    return StrandcastError("SC-W002", what, file=file, exit_code=ENVIRONMENT)
