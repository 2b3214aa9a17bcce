"""Decoding of a video in a separate process.

A damaged or hostile file may crash, hang or exhaust its decoder; that ends in one clear error here. Decoding
also runs in parallel with the caller. `strandcast.video.decoding_process` documents their protocol.
"""

import json
import mmap
import os
import resource
import select
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from strandcast.errors import ENVIRONMENT, INTEGRITY, StrandcastError
from strandcast.records.files import open_scratch
from strandcast.records.folders import files_of_video
from strandcast.video import decoding_process
from strandcast.video.decoding_process import Request, slots_of
from strandcast.video.source import Contents, Grey, VideoInfo

# -P: import no module from the working directory.
COMMAND = [sys.executable, "-P", "-m", decoding_process.__name__]
CHECK_HOST = "check the limits of this computer (`ulimit -a`) and the installation"
NO_MEMORY = (
    "MemoryError",
    "Cannot allocate memory",
    "cannot allocate memory",
    "failed to map segment",
    "Memory allocation",
)
LIBRARIES_BYTES = 1 << 29  # address space of Python and its libraries: 0.4 GiB measured
READ_BYTES = 1 << 16
RELEASED_AT_ONCE = decoding_process.LEAST_SLOTS - 1  # few enough that the ring never runs empty
SLOWEST_BYTES_S = 5e6  # chosen: read rate of a slow disk or network
# Limits of a decoding process.
MEMORY_BYTES = 3 << 29  # address space beyond that of Python and its libraries (Linux)
CPU_S = 120  # CPU time between 64 frames
STALL_S = 60.0  # wall time without a frame after which it is killed
# The decoding process does not start computation threads.
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


class DecoderProcess:
    """A running decoding process: its records, and why it ended."""

    def __init__(self, request: Request, stall_s: float, errors: IO[bytes]) -> None:
        self.path, self._stall_s, self._errors = request.path, stall_s, errors
        self._of_photos = request.photo_flags is not None
        self.frames = 0
        self.process = self._start(request)
        assert self.process.stdout is not None
        assert self.process.stdin is not None
        self._records, self._requests = self.process.stdout.fileno(), self.process.stdin.fileno()
        self._poll = select.poll()
        self._poll.register(self._records, select.POLLIN)
        self._lines: list[bytes] = []
        self._rest = b""
        self._released = 0

    def _start(self, request: Request) -> subprocess.Popen[bytes]:
        try:
            return subprocess.Popen(
                [*COMMAND, json.dumps(asdict(request))],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                pass_fds=[] if request.ring is None else [request.ring],
                env=os.environ | ONE_THREAD,
                bufsize=0,
                process_group=0,  # Ctrl-C reaches this process only, which then kills the other
            )
        except OSError as error:  # e.g. no more processes are allowed
            raise self._failed("SC-W004", f"could not be started ({error.strerror})", CHECK_HOST) from error

    def next(self) -> Any:
        """Return its next record; raise the error that it reports, or SC-V005 or SC-W004 if it fails."""
        while not self._lines:
            if not self._poll.poll(1000.0 * self._stall_s):
                raise self._failed("SC-V005", f"returned no frame for {self._stall_s:g} s")
            data = os.read(self._records, READ_BYTES)
            if not data:
                raise self._ended()
            *lines, self._rest = (self._rest + data).split(b"\n")
            self._lines = lines[::-1]
        record = json.loads(self._lines.pop())
        if isinstance(record, dict) and "error" in record:
            raise StrandcastError(**record["error"])
        if isinstance(record, dict) and "memory" in record:
            raise self._out_of_memory()
        return record

    def release(self) -> None:
        """Release one more slot of the ring; releases are sent in groups."""
        self._released += 1
        if self._released < RELEASED_AT_ONCE:
            return
        self._write(b"+" * self._released)
        self._released = 0

    def photo(self, path: Path) -> Any:
        """Request a photo; return shape and type of what is now in the shared file, or None."""
        self.path = str(path)
        self._write(json.dumps(self.path).encode() + b"\n")
        return self.next()["photo"]

    def _write(self, request: bytes) -> None:
        with suppress(BrokenPipeError):  # it has ended; its last record says how
            os.write(self._requests, request)

    def _ended(self) -> StrandcastError:
        """Return why it ended without a final record."""
        code = self.process.wait()
        self._errors.seek(0)
        output = self._errors.read().decode(errors="replace").strip()
        if code != -signal.SIGKILL and any(words in output for words in NO_MEMORY):
            return self._out_of_memory()
        if code >= 0:
            last = output.splitlines()[-1] if output else f"exit code {code}"
            return self._failed("SC-W004", f"stopped: {last}", CHECK_HOST)
        if -code == signal.SIGXCPU:
            return self._failed("SC-V005", f"returned no frame for {CPU_S} s of CPU time")
        if -code == signal.SIGKILL:
            what = "was killed (SIGKILL), as the system does if memory runs out"
            return self._failed("SC-W004", what)
        return self._failed("SC-V005", f"crashed ({signal.Signals(-code).name})")

    def _out_of_memory(self) -> StrandcastError:
        """Return the error of a decoder without memory: a limit of the host's, if that is below ours."""
        allowed = resource.getrlimit(resource.RLIMIT_AS)[0]
        needed = MEMORY_BYTES + LIBRARIES_BYTES
        if allowed == resource.RLIM_INFINITY or allowed >= needed:
            return self._failed("SC-V005", f"needs more than {MEMORY_BYTES / 2**30:.1f} GiB of memory")
        what = f"may need {needed / 2**30:.1f} GiB of memory, but `ulimit -v` allows {allowed / 2**30:.2f}"
        return self._failed("SC-W004", what)

    def _failed(self, code: str, what: str, fix: str | None = None) -> StrandcastError:
        return StrandcastError(
            code,
            f"its decoder {what}" + ("" if self._of_photos else f", after {self.frames} frames"),
            file=self.path,
            cost=None if self._of_photos else "the rest of the throw is missing",
            fix=fix,
            exit_code=INTEGRITY if code == "SC-V005" else ENVIRONMENT,
        )

    def close(self) -> None:
        """Kill the process."""
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                pipe.close()


@contextmanager
def _running(request: Request, stall_s: float) -> Iterator[DecoderProcess]:
    with (
        _unnamed_file("strandcast-messages") as errors,
        closing(DecoderProcess(request, stall_s, errors)) as decoder,
    ):
        yield decoder


def probe_isolated(path: str | Path) -> Contents:
    """Return a video's contents, probed in a separate process; the whole file is read."""
    size = sum(file.stat().st_size for file in files_of_video(Path(path)))
    request = Request(str(path), None, MEMORY_BYTES, CPU_S)
    with _running(request, STALL_S + size / SLOWEST_BYTES_S) as decoder:
        return Contents(**decoder.next()["contents"])


@dataclass
class Decoding:
    """A video being decoded by a separate process."""

    decoder: DecoderProcess
    info: VideoInfo
    slots: list[Grey]
    messages: list[str] = field(default_factory=list)

    def frames(self) -> Iterator[tuple[float, Grey, bool]]:
        """Yield time [s], grey image, and whether it is an exact copy of the previous frame."""
        while isinstance(record := self.decoder.next(), list):
            time_s, copy, messages = record
            self.messages.extend(messages)
            self.decoder.frames += 1
            yield time_s, self.slots[(self.decoder.frames - 1) % len(self.slots)], copy
            self.decoder.release()
        self.messages[:] = record["messages"]


@contextmanager
def decode_isolated(path: str | Path, threads: int, frames: int | None) -> Iterator[Decoding]:
    """Decode a video in a separate process; arguments as for `strandcast.video.reader.open_video`."""
    with _unnamed_file("strandcast-frames") as shared:
        request = Request(str(path), shared.fileno(), MEMORY_BYTES, CPU_S, threads, frames)
        with _running(request, STALL_S) as decoder:
            head = decoder.next()
            info = VideoInfo(**head["info"] | {"path": Path(path)})
            # The map outlives the file, and each image keeps a reference to it.
            slots = slots_of(mmap.mmap(shared.fileno(), 0), info, head["slots"])
            greys = [np.frombuffer(slot, info.dtype).reshape(info.height, info.width) for slot in slots]
            yield Decoding(decoder, info, greys)


def read_photos(paths: Sequence[Path], flags: int) -> Iterator[np.ndarray | None]:
    """Yield single pictures, decoded in a separate process as ``cv2.imread`` does; None: not a picture.

    Raises
    ------
    StrandcastError
        SC-V007 a picture is too large; SC-V005, SC-W004 as for videos.
    """
    with _unnamed_file("strandcast-photo") as shared:
        request = Request("", shared.fileno(), MEMORY_BYTES, CPU_S, photo_flags=flags)
        with _running(request, STALL_S) as decoder:
            for path in paths:
                photo = decoder.photo(path)
                yield None if photo is None else _copied(shared, *photo)


def _copied(shared: IO[bytes], shape: list[int], dtype: str) -> np.ndarray:
    with mmap.mmap(shared.fileno(), 0, access=mmap.ACCESS_READ) as pixels:
        return np.frombuffer(bytearray(pixels), dtype).reshape(shape)


def _unnamed_file(name: str) -> IO[bytes]:
    """Return an open file, in memory where the system has that; it disappears with its last process."""
    if hasattr(os, "memfd_create"):  # needs neither /tmp nor /dev/shm
        return os.fdopen(os.memfd_create(name), "r+b")
    return open_scratch()
