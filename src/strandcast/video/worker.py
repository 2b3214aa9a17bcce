"""The process that decodes: `python -m strandcast.video.worker REQUEST`, started by `strandcast.video.child`.

A damaged or hostile file can make a decoder crash, hang or eat all memory. Here it may: limits end this
process, and the one that asked goes on. Frames are written into memory that both processes share, a ring of
slots; what is said about them goes as lines of JSON through a pipe, and for each slot that may be used again
one byte comes back. When the other side is gone, either pipe tells and this process ends.
"""

from __future__ import annotations

import errno
import json
import mmap
import os
import resource
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.video.formats import open_source, probe
from strandcast.video.source import Grey, Source, VideoInfo, is_copy

RING_BYTES = 64 << 20
LEAST_SLOTS, MOST_SLOTS = 4, 12
REARM = 64  # frames after which the CPU limit starts anew


@dataclass(frozen=True)
class Request:
    """What is asked of a decoding process.

    Attributes
    ----------
    path
        The video.
    ring
        Descriptor of the file that both sides map; None asks for the video's contents only.
    threads, frames
        As in `strandcast.video.reader.open_video`.
    keep
        Frames that the other side may hold on to.
    memory_bytes, cpu_s
        What the process may take besides what Python itself does; CPU time between frames.
    """

    path: str
    ring: int | None
    threads: int
    frames: int | None
    keep: int
    memory_bytes: int
    cpu_s: int


def main() -> None:
    """Serve one request."""
    request = Request(**json.loads(sys.argv[1]))
    # What libraries print must not come between the records.
    records = os.dup(1)
    os.dup2(2, 1)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a crash is told, not kept
    _limit_memory(request.memory_bytes)
    _limit_cpu(request.cpu_s)
    try:
        if request.ring is None:
            _say(records, contents=asdict(probe(request.path)))
        else:
            _decode(request, request.ring, records)
    except StrandcastError as error:
        _say(records, error=_told(error))
    except MemoryError:
        _say(records, memory=True)
    except BrokenPipeError:
        pass
    except OSError as error:
        if error.errno != errno.ENOMEM:
            raise
        _say(records, memory=True)


def _say(records: int, **record: Any) -> None:
    _write(records, record)


def _write(records: int, record: Any) -> None:
    data = json.dumps(record).encode() + b"\n"
    while data:
        data = data[os.write(records, data) :]


def _told(error: StrandcastError) -> dict[str, Any]:
    """Return an error's parts; the one that asked makes it again from them."""
    return dict(vars(error))


def _limit_memory(extra_bytes: int) -> None:
    """Let memory grow by so much from here, where the system keeps count of it (macOS does not)."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except OSError:
        return
    limit = pages * os.sysconf("SC_PAGE_SIZE") + extra_bytes
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))


def _limit_cpu(seconds: int) -> None:
    """Let the process take so much CPU time from now; SIGXCPU ends it then."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    most = resource.getrlimit(resource.RLIMIT_CPU)[1]
    resource.setrlimit(resource.RLIMIT_CPU, (int(used.ru_utime + used.ru_stime) + seconds, most))


def _decode(request: Request, descriptor: int, records: int) -> None:
    with open_source(request.path, request.threads, request.frames) as source:
        slots = _ring(source.info, descriptor, request.keep)
        _say(records, info=vars(source.info) | {"path": request.path}, slots=len(slots))
        try:
            _fill(source, slots, request.cpu_s, records)
        except StrandcastError as error:
            _say(records, error=_told(error), messages=source.messages())
        else:
            _say(records, end=True, messages=source.messages())


def _ring(info: VideoInfo, descriptor: int, keep: int) -> list[Grey]:
    """Map the shared memory; returns its slots, one frame each, to which whole pages belong."""
    each = slot_bytes(info)
    count = keep + min(max(RING_BYTES // each, LEAST_SLOTS), MOST_SLOTS)
    os.ftruncate(descriptor, count * each)
    return slots_of(mmap.mmap(descriptor, count * each), info, count)


def slot_bytes(info: VideoInfo) -> int:
    """Return the bytes from one slot of the ring to the next: a frame's, filled up to whole pages."""
    frame = info.width * info.height * info.dtype.itemsize
    return -(-frame // mmap.PAGESIZE) * mmap.PAGESIZE


def slots_of(ring: mmap.mmap, info: VideoInfo, count: int) -> list[Grey]:
    """Return the slots of a ring as grey images."""
    pixels = info.width * info.height
    return [
        np.frombuffer(ring, info.dtype, pixels, slot * slot_bytes(info)).reshape(info.height, info.width)
        for slot in range(count)
    ]


def _fill(source: Source, slots: list[Grey], cpu_s: int, records: int) -> None:
    free, told = len(slots), 0
    for index, (time_s, raw) in enumerate(source.raws):
        if free == 0:
            free = len(os.read(0, len(slots)))
            if free == 0:
                raise BrokenPipeError
        free -= 1
        grey = source.to_grey(raw, slots[index % len(slots)])
        copy = index > 0 and is_copy(grey, slots[(index - 1) % len(slots)])
        messages = source.messages()[told:]
        told += len(messages)
        _write(records, [time_s, copy, messages])
        if index % REARM == 0:
            _limit_cpu(cpu_s)


if __name__ == "__main__":
    main()
