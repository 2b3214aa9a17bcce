"""A video decoded in a process of its own, beside the one that looks at the frames.

The file is foreign: whatever it does to its decoder, here it ends in one clear error. And the decoder runs
while this process works on the frames before. `strandcast.video.worker` tells what the two say to each other.
"""

from __future__ import annotations

import json
import mmap
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import IO, Any

from strandcast.errors import ENVIRONMENT, INTEGRITY, StrandcastError
from strandcast.video import worker
from strandcast.video.files import files_of
from strandcast.video.source import Contents, Grey, VideoInfo
from strandcast.video.worker import Request, slots_of

COMMAND = [sys.executable, "-P", "-m", worker.__name__]  # -P: no module from the folder that this runs in
READ_BYTES = 1 << 16
TOLD_AT_ONCE = worker.LEAST_SLOTS - 1  # the ring never runs dry for want of a word
SLOWEST_BYTES_S = 5e6  # at which a disk or a network gives a file
# The decoding process does its own work alone.
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


@dataclass(frozen=True)
class Limits:
    """What a decoding process may take.

    Attributes
    ----------
    memory_bytes
        Address space besides what Python and its libraries take (Linux).
    cpu_s
        CPU time between 64 frames.
    stall_s
        Wall time without a frame, after which it is ended.
    """

    memory_bytes: int = 3 << 29
    cpu_s: int = 120
    stall_s: float = 60.0


class Child:
    """A running decoding process: what it says, and why it ended."""

    def __init__(self, request: Request, limits: Limits, errors: IO[bytes]) -> None:
        self.path, self.limits, self._errors = request.path, limits, errors
        self.frames = 0
        self.process = subprocess.Popen(
            [*COMMAND, json.dumps(asdict(request))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            pass_fds=[] if request.ring is None else [request.ring],
            env=os.environ | ONE_THREAD,
            bufsize=0,
            process_group=0,  # Ctrl-C is for this process, which then ends the other
        )
        assert self.process.stdout is not None
        assert self.process.stdin is not None
        self._said, self._asked = self.process.stdout.fileno(), self.process.stdin.fileno()
        self._poll = select.poll()
        self._poll.register(self._said, select.POLLIN)
        self._lines: list[bytes] = []
        self._rest = b""
        self._owed = 0

    def next(self) -> Any:
        """Return its next record; raises what it reports, and SC-V031 to V034 when it fails."""
        while not self._lines:
            if not self._poll.poll(1000.0 * self.limits.stall_s):
                raise self._failed("SC-V032", f"gave no frame for {self.limits.stall_s:g} s")
            data = os.read(self._said, READ_BYTES)
            if not data:
                raise self._ended()
            *lines, self._rest = (self._rest + data).split(b"\n")
            self._lines = lines[::-1]
        record = json.loads(self._lines.pop())
        if isinstance(record, dict) and "error" in record:
            raise _again(record["error"])
        if isinstance(record, dict) and "memory" in record:
            raise self._failed(
                "SC-V033", f"needs more than {self.limits.memory_bytes / 2**30:.1f} GiB of memory"
            )
        return record

    def release(self) -> None:
        """Let it use one more slot of the ring; it is told of several at once."""
        self._owed += 1
        if self._owed < TOLD_AT_ONCE:
            return
        try:
            os.write(self._asked, b"+" * self._owed)
            self._owed = 0
        except BrokenPipeError:  # it has ended; its records tell how
            pass

    def _ended(self) -> StrandcastError:
        """Return why it ended without a last word."""
        code = self.process.wait()
        if code >= 0:
            self._errors.seek(0)
            words = self._errors.read().decode(errors="replace").strip().splitlines()
            return self._failed("SC-V034", f"stopped: {words[-1] if words else f'exit code {code}'}")
        if -code == signal.SIGXCPU:
            return self._failed("SC-V032", f"gave no frame for {self.limits.cpu_s} s of CPU time")
        return self._failed("SC-V031", f"crashed ({signal.Signals(-code).name})")

    def _failed(self, code: str, what: str) -> StrandcastError:
        return StrandcastError(
            code,
            f"its decoder {what}, after {self.frames} frames",
            file=self.path,
            cost="the rest of the throw is not seen",
            fix="copy the file again from the camera; if it still happens, convert it with another program",
            exit_code=ENVIRONMENT if code == "SC-V034" else INTEGRITY,
        )

    def end(self) -> None:
        """End the process, whatever it does."""
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                pipe.close()


def _again(parts: dict[str, Any]) -> StrandcastError:
    return StrandcastError(parts.pop("code"), parts.pop("what"), **parts)


@contextmanager
def _running(request: Request, limits: Limits) -> Iterator[Child]:
    with tempfile.TemporaryFile() as errors:
        child = Child(request, limits, errors)
        try:
            yield child
        finally:
            child.end()


def probe_in_child(path: str | Path, limits: Limits) -> Contents:
    """Return what a video holds, as a process of its own finds it; all of the file is read for that."""
    size = sum(file.stat().st_size for file in files_of(path))
    limits = replace(limits, stall_s=limits.stall_s + size / SLOWEST_BYTES_S)
    request = Request(str(path), None, 1, None, 0, limits.memory_bytes, limits.cpu_s)
    with _running(request, limits) as child:
        return Contents(**child.next()["contents"])


@dataclass
class Decoding:
    """A video being decoded by a child: its frames' time (s), grey image and whether it is a copy."""

    child: Child
    info: VideoInfo
    slots: list[Grey]
    keep: int
    messages: list[str]

    def frames(self) -> Iterator[tuple[float, Grey, bool]]:
        """Yield time (s), grey image, and whether it is an exact copy of the one before."""
        while isinstance(record := self.child.next(), list):
            time_s, copy, messages = record
            self.messages.extend(messages)
            self.child.frames += 1
            yield time_s, self.slots[(self.child.frames - 1) % len(self.slots)], copy
            if self.child.frames >= self.keep:
                self.child.release()
        self.messages[:] = record["messages"]


@contextmanager
def decode_in_child(
    path: str | Path, threads: int, frames: int | None, keep: int, limits: Limits
) -> Iterator[Decoding]:
    """Decode a video in a process of its own; arguments as of `strandcast.video.reader.open_video`."""
    with _shared_file() as shared:
        request = Request(
            str(path), shared.fileno(), threads, frames, keep, limits.memory_bytes, limits.cpu_s
        )
        with _running(request, limits) as child:
            head = child.next()
            info = VideoInfo(**head["info"] | {"path": Path(path)})
            # The map outlives the file, and each image keeps it: none is ever left pointing nowhere.
            ring = mmap.mmap(shared.fileno(), 0)
            yield Decoding(child, info, slots_of(ring, info, head["slots"]), keep, [])


def _shared_file() -> IO[bytes]:
    """Return an open file without a name: it goes when the last process that has it open goes."""
    if hasattr(os, "memfd_create"):
        return os.fdopen(os.memfd_create("strandcast-frames"), "r+b")
    return tempfile.TemporaryFile()
