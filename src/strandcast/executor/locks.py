"""The host's part in a run: a folder for the log, disk space, the clock, and one run per arm at a time."""

import fcntl
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from strandcast.errors import StrandcastError
from strandcast.records.files import existing_folder, in_bytes

NOTHING_SENT = "nothing was sent to the arm"
# Chosen; not sensitive.
MIN_FREE_BYTES = 64 << 20
MAX_CLOCK_RESOLUTION_S = 1e-5
MAX_CLOCK_LAG_S = 120.0


def check_folder(out_dir: Path) -> None:
    """Refuse a folder that already has a run (SC-X010), is not writable, or is on a full disk (SC-W002).

    If the folder does not exist yet, its nearest existing parent is tested; a refused run creates nothing.
    """
    if (out_dir / "run.json").exists():
        raise StrandcastError(
            "SC-X010",
            "this trial has already been played",
            file=out_dir / "run.json",
            cost=NOTHING_SENT,
            fix="play the next trial, or move a failed run away",
        )
    existing = existing_folder(out_dir)
    try:
        with tempfile.TemporaryFile(dir=existing) as probe:
            probe.write(b"log")
        free = shutil.disk_usage(existing).free
    except OSError as error:
        raise _no_place(out_dir, f"the log cannot be written there ({error.strerror})") from None
    if free < MIN_FREE_BYTES:
        raise _no_place(out_dir, f"the disk has {free >> 20} MiB free, needed {MIN_FREE_BYTES >> 20}")


def reserve_space(out_dir: Path, size_bytes: int) -> IO[bytes]:
    """Return a file that holds disk space until it is closed, just before the log is written.

    Free space alone says nothing about quotas. The file has no name, so it disappears with this process.

    Raises
    ------
    StrandcastError
        SC-W002 the space cannot be had.
    """
    try:
        reserve = tempfile.TemporaryFile(dir=existing_folder(out_dir))  # noqa: SIM115  (the caller closes it)
        reserve.write(os.urandom(size_bytes))  # random, so that no file system compresses it
        reserve.flush()
        os.fsync(reserve.fileno())  # network file systems check a quota only here
    except OSError as error:
        what = f"the log needs up to {in_bytes(size_bytes)}, which cannot be reserved ({error.strerror})"
        raise _no_place(out_dir, what) from error
    return reserve


def _no_place(out_dir: Path, what: str) -> StrandcastError:
    return StrandcastError("SC-W002", what, file=out_dir, cost=NOTHING_SENT)


def check_clock(motion_path: Path) -> None:
    """Refuse a host with a coarse clock, or one that is behind the motion's file (SC-W007)."""
    coarse = time.get_clock_info("monotonic").resolution > MAX_CLOCK_RESOLUTION_S
    behind_s = motion_path.stat().st_mtime - time.time()
    if coarse or behind_s > MAX_CLOCK_LAG_S:
        what = "is too coarse" if coarse else f"is {behind_s:.0f} s behind the motion's file"
        raise StrandcastError("SC-W007", f"the host's clock {what}", file=motion_path, cost=NOTHING_SENT)


@contextmanager
def one_run(address: str | None) -> Iterator[None]:
    """Hold the lock of the arm at `address` (None: a virtual arm, which needs none); SC-W010 if it is taken.

    The system releases it when the process ends, in any way. The file stays, whoever created it.
    """
    if address is None:
        yield
        return
    # Not TMPDIR: all users and terminals must meet there.
    path = Path("/tmp") / f"strandcast-{re.sub(r'[^A-Za-z0-9.-]', '_', address)}.lock"
    with _open_lock(path) as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise StrandcastError(
                "SC-W010",
                f"another run moves the arm at {address}",
                file=path,
                cost=NOTHING_SENT,
                fix="wait until that run has ended",
            ) from None
        yield


def _open_lock(path: Path) -> IO[str]:
    try:
        return path.open()  # another user's file may be read-only; that is enough to lock it
    except FileNotFoundError:
        lock = path.open("a")
        path.chmod(0o666)  # whatever the umask, for the next user
        return lock
