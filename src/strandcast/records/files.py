"""Atomic writing (a reader finds the old file or the new one, never a part), hashing, canonical JSON."""

import errno
import hashlib
import json
import os
import resource
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from strandcast.errors import ENVIRONMENT, StrandcastError

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
# How network and memory-card file systems refuse a request that they do not support, such as chmod.
UNSUPPORTED = (errno.EPERM, errno.EACCES, errno.EINVAL, errno.ENOTSUP, errno.ENOSYS, errno.EBADF)


@contextmanager
def atomic_write(path: str | Path, size_bytes: int | None = None) -> Iterator[Path]:
    """Yield a temporary path beside `path`; on success it replaces `path`, on failure it is deleted.

    The temporary file keeps the suffix, because some libraries choose the format by it. `size_bytes` is the
    file's size, where it is known: an error then says how much room is needed.

    Raises
    ------
    StrandcastError
        SC-R041 there is no room for the file; SC-W002 the system refuses to write it.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}.", suffix=f".tmp{path.suffix}", dir=path.parent)
    except OSError as error:
        raise _not_written(error, path, size_bytes, 0) from error
    temporary = Path(name)
    try:
        os.close(handle)
        yield temporary
        _if_supported(lambda: temporary.chmod(0o666 & ~_umask()))
        _if_supported(lambda: _sync(temporary))
        temporary.replace(path)
        _if_supported(lambda: _sync(path.parent))
    except OSError as error:
        if error.errno is None or error.filename not in (None, name):  # another file's error
            raise
        written = temporary.stat().st_size if temporary.exists() else 0
        raise _not_written(error, path, size_bytes, written) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _if_supported(request: Callable[[], None]) -> None:
    """Make a request that some file systems refuse, and without which the file is right nevertheless."""
    try:
        request()
    except OSError as error:
        if error.errno not in UNSUPPORTED:
            raise


def _not_written(error: OSError, path: Path, size_bytes: int | None, written: int) -> StrandcastError:
    reason = os.strerror(error.errno) if error.errno else str(error)
    if error.errno not in NO_ROOM:
        return StrandcastError("SC-W002", f"cannot be written ({reason})", file=path, exit_code=ENVIRONMENT)
    needed = f"more than {in_bytes(written)}" if size_bytes is None else in_bytes(size_bytes)
    what = f"there is no room for it ({reason}): {needed} needed, {_room(error.errno, path, written)}"
    fix = "delete what is not needed there, or move the project to a larger disk; then run the same command"
    if error.errno == errno.EFBIG:
        fix = "raise the limit of file sizes (`ulimit -f`), then run the same command"
    cost = "nothing was changed; all finished results are kept"
    return StrandcastError("SC-R041", what, file=path, cost=cost, fix=fix, exit_code=ENVIRONMENT)


def _room(number: int, path: Path, written: int) -> str:
    """Return in words how large a file may be, after the part that was written is deleted."""
    if number == errno.EFBIG:
        return f"{in_bytes(resource.getrlimit(resource.RLIMIT_FSIZE)[0])} allowed for a file"
    free = f"{in_bytes(free_bytes(path) + written)} free on this disk"
    return f"{free}, but your quota is used up" if number == errno.EDQUOT else free


def free_bytes(path: str | Path) -> int:
    """Return the free space where a file or folder lies, or will lie [bytes]."""
    return shutil.disk_usage(existing_folder(path)).free


def existing_folder(path: str | Path) -> Path:
    """Return a path, or the nearest of its parents that exists."""
    path = Path(path).absolute()
    return next(each for each in (path, *path.parents) if each.exists())


def check_room(folder: Path, least_bytes: int) -> None:
    """Refuse a folder in which, once it exists, nothing can be written, or too little.

    Raises
    ------
    StrandcastError
        SC-R041 there is too little room; SC-W002 the system refuses to write there.
    """
    try:
        with tempfile.TemporaryFile(dir=existing_folder(folder)) as probe:
            probe.write(b"probe")
        if free_bytes(folder) < least_bytes:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    except OSError as error:
        raise _not_written(error, folder, least_bytes, 0) from error


def in_bytes(size: float) -> str:
    """Return a size in words, as `df -H` gives it."""
    for unit in ("B", "kB", "MB"):
        if size < 1000.0:
            return f"{size:.3g} {unit}"
        size /= 1000.0
    return f"{size:.3g} GB"


def open_scratch() -> IO[bytes]:
    """Open an unnamed file among the system's temporary files; it disappears when it is closed.

    Raises
    ------
    StrandcastError
        SC-R041 no folder for temporary files can be written.
    """
    try:
        return tempfile.TemporaryFile(prefix="strandcast-")
    except OSError as error:
        raise no_scratch(error) from error


def no_scratch(error: OSError) -> StrandcastError:
    """Return the error of temporary files that cannot be written."""
    place = tempfile.tempdir or "there is no folder for them"
    free = f"; {in_bytes(free_bytes(place))} free" if tempfile.tempdir else ""
    return StrandcastError(
        "SC-R041",
        f"temporary files cannot be written ({error.strerror or error}{free})",
        file=place,
        fix="delete what is not needed there, or set TMPDIR to a folder on a disk with room",
        exit_code=ENVIRONMENT,
    )


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_text(path: str | Path, text: str) -> None:
    """Write text atomically as UTF-8, with line ends unchanged."""
    write_bytes(path, text.encode())


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write bytes atomically."""
    with atomic_write(path, len(data)) as temporary:
        temporary.write_bytes(data)


def absolute(path: str | Path) -> str:
    """Return a path from the root on, as `Path.absolute`, but as text: at a tenth of the time."""
    name, here = os.fspath(path), os.getcwd()  # noqa: PTH109
    return here if name == "." else os.path.join(here, name)  # noqa: PTH118


def sha256_file(path: str | Path) -> str:
    """Return the SHA-256 of a file's bytes, in hex."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def canonical_json(data: Any) -> str:
    """Return the canonical JSON text: sorted keys, no spaces, shortest floats, no NaN or infinity."""
    return json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False, ensure_ascii=False)


def content_sha256(data: Any) -> str:
    """Return the SHA-256 of `data` in canonical form, in hex."""
    return hashlib.sha256(canonical_json(data).encode()).hexdigest()


def remove_temporary_files(folder: Path) -> None:
    """Remove what writers that were killed left behind in a folder, named as `atomic_write` does."""
    for path in folder.glob(".*.tmp*"):
        path.unlink(missing_ok=True)
