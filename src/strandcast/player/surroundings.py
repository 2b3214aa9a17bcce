"""The host around a run: the folder for the log, room on the disk, the clock, and one run per arm."""

from __future__ import annotations

import fcntl
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from strandcast.errors import StrandcastError

NOTHING_SENT = "nothing was sent to the arm"
LEAST_FREE_BYTES = 64 << 20
COARSEST_CLOCK_S = 1e-5
CLOCK_WITHIN_S = 120.0


def check_folder(out_dir: Path) -> None:
    """Refuse a folder that has a run already, cannot be written to, or lies on a full disk.

    A folder that is not there yet is tried by the one that it will be made in: a refused run leaves nothing.

    Raises
    ------
    StrandcastError
        SC-X010 played already, SC-X014 no place for the log.
    """
    if (out_dir / "run.json").exists():
        raise StrandcastError(
            "SC-X010", "this trial has been played already", file=out_dir / "run.json",
            cost=NOTHING_SENT, fix="play the next trial; or move away a run that failed")  # fmt: skip
    there = next(folder for folder in (out_dir, *out_dir.absolute().parents) if folder.exists())
    try:
        with tempfile.TemporaryFile(dir=there) as probe:
            probe.write(b"log")
        free = shutil.disk_usage(there).free
    except OSError as error:
        raise _no_place(out_dir, f"the log cannot be written there ({error.strerror})") from None
    if free < LEAST_FREE_BYTES:
        raise _no_place(out_dir, f"the disk has {free >> 20} MiB left, wanted {LEAST_FREE_BYTES >> 20}")


def _no_place(out_dir: Path, what: str) -> StrandcastError:
    fix = "mend the path, the rights or the room on the disk"
    return StrandcastError("SC-X014", what, file=out_dir, cost=NOTHING_SENT, fix=fix)


def check_clock(motion_path: Path) -> None:
    """Refuse a host whose clock is coarse, or behind the motion that was written before.

    Raises
    ------
    StrandcastError
        SC-X015.
    """
    coarse = time.get_clock_info("monotonic").resolution > COARSEST_CLOCK_S
    behind_s = motion_path.stat().st_mtime - time.time()
    if coarse or behind_s > CLOCK_WITHIN_S:
        what = "is too coarse to keep time by" if coarse else f"is {behind_s:.0f} s behind the motion's file"
        raise StrandcastError("SC-X015", f"the host's clock {what}", file=motion_path, cost=NOTHING_SENT,
                              fix="set the host's clock")  # fmt: skip


@contextmanager
def one_run(address: str | None) -> Iterator[None]:
    """Hold the lock of the arm at `address` (None: a virtual arm, which needs none).

    The system gives it back when the process ends, however it ends; the file stays, whoever has made it.

    Raises
    ------
    StrandcastError
        SC-X016 another run moves this arm.
    """
    if address is None:
        yield
        return
    path = Path(tempfile.gettempdir()) / f"strandcast-{re.sub(r'[^A-Za-z0-9.-]', '_', address)}.lock"
    with _opened(path) as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise StrandcastError(
                "SC-X016", f"another run moves the arm at {address}", file=path, cost=NOTHING_SENT,
                fix="wait until it is over") from None  # fmt: skip
        yield


def _opened(path: Path) -> IO[str]:
    try:
        return path.open()  # another user's may be read alone, and that is enough to lock it
    except FileNotFoundError:
        return path.open("a")
