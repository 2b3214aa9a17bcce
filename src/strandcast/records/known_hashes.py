"""Hashes of the contents of files, computed once for a file that stays as it is.

A file stays as it is if its size, inode and both times do: whatever writes to a file changes its ctime, which
nobody can set. Only a second change within the step of the clock of its file system is not seen so; therefore
a hash is kept from one process to the next only if the file was older than that when it was read.
"""

import json
import os
import tempfile
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from strandcast.records.files import absolute, atomic_write, canonical_json

FILE = Path(".snakemake", "hashes.json")
CLOCK_STEP_NS = 2_000_000_000  # of FAT; other file systems have a finer one


class _Known(NamedTuple):
    facts: tuple[int, ...]
    sha256: str
    read_ns: int | None  # when, by this computer's clock; None: by another process, long enough after


_KNOWN: dict[str, _Known] = {}  # by absolute path


def content_sha256_of(path: str | Path) -> str:
    """Return the hash of a file's content, by which one result names another (`content_hash`)."""
    name, now_ns = absolute(path), time.time_ns()
    found = os.stat(name)  # noqa: PTH116  (text, as `absolute` says)
    facts = (found.st_size, found.st_ino, found.st_mtime_ns, found.st_ctime_ns)
    known = _KNOWN.get(name)
    if known is None or known.facts != facts:
        from strandcast.records.content_hash import result_sha256

        known = _KNOWN[name] = _Known(facts, result_sha256(path), now_ns)
    return known.sha256


@contextmanager
def remembered(root: Path) -> Iterator[None]:
    """Take the hashes of a project's files that were computed before, and keep those computed within."""
    file, top = root.absolute() / FILE, f"{root.absolute()}{os.sep}"
    before = _read(file)
    for name, (sha256, *facts) in before.items():
        _KNOWN.setdefault(top + name, _Known(tuple(facts), sha256, None))
    try:
        yield
    finally:
        if file.parent.is_dir():
            with suppress(OSError):
                ahead_ns = _clock_ahead_ns(file.parent)
                now = {
                    name.removeprefix(top): [known.sha256, *known.facts]
                    for name, known in _KNOWN.items()
                    if name.startswith(top) and _is_settled(known, ahead_ns)
                }
                if now != before:
                    _write(file, now)


def _is_settled(known: _Known, ahead_ns: int) -> bool:
    """Return whether a file was not changed just before it was read, by the clock of its file system."""
    if known.read_ns is None:
        return True
    *_, mtime_ns, ctime_ns = known.facts
    return all(abs(known.read_ns + ahead_ns - each) > CLOCK_STEP_NS for each in (mtime_ns, ctime_ns))


def _clock_ahead_ns(folder: Path) -> int:
    """Return how far the clock of a folder's file system is ahead of this computer's [ns]."""
    with tempfile.TemporaryFile(dir=folder) as probe:
        return os.fstat(probe.fileno()).st_mtime_ns - time.time_ns()


def _read(file: Path) -> dict[str, list[Any]]:
    """Return the hashes in a file, with its check sum in the first line; none of a damaged file."""
    try:
        check, _, text = file.read_bytes().partition(b"\n")
        return dict(json.loads(text)) if int(check) == zlib.crc32(text) else {}
    except (OSError, ValueError):
        return {}


def _write(file: Path, hashes: dict[str, list[Any]]) -> None:
    text = canonical_json(hashes).encode()
    with atomic_write(file) as temporary:
        temporary.write_bytes(b"%d\n%s" % (zlib.crc32(text), text))
