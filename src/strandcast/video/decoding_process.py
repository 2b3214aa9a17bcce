"""The process that decodes a video: `python -m strandcast.video.decoding_process REQUEST`.

`strandcast.video.isolated` starts it. A damaged or hostile file can make a decoder crash, hang or exhaust
memory. Limits then end this process, and its parent continues. Frames are written to a ring of slots in
shared memory; their records go as lines of JSON through a pipe, and one byte comes back for each released
slot. If the parent ends, a pipe breaks and this process ends.
"""

import errno
import json
import mmap
import os
import resource
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from strandcast.errors import StrandcastError
from strandcast.video.registry import reader_of
from strandcast.video.source import Source, VideoInfo, is_copy

RING_BYTES = 64 << 20
LEAST_SLOTS, MOST_SLOTS = 4, 12
REARM = 64  # chosen: frames after which the CPU limit restarts


@dataclass(frozen=True)
class Request:
    """A request to a decoding process.

    Attributes
    ----------
    path
        The video.
    ring
        Descriptor of the shared file; None requests the video's contents only.
    memory_bytes, cpu_s
        Memory beyond Python's own; CPU time per 64 frames.
    threads, frames
        As in `strandcast.video.reader.open_video`.
    photo_flags
        OpenCV's flags, to decode single pictures instead of a video; their paths come through the pipe.
    """

    path: str
    ring: int | None
    memory_bytes: int
    cpu_s: int
    threads: int = 1
    frames: int | None = None
    photo_flags: int | None = None


def main() -> None:
    """Serve one request."""
    request = Request(**json.loads(sys.argv[1]))
    # Output of libraries must not mix with the records.
    records = os.dup(1)
    os.dup2(2, 1)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # no core dumps
    _limit_memory(request.memory_bytes)
    _limit_cpu(request.cpu_s)
    try:
        if request.ring is None:
            _send(records, {"contents": asdict(reader_of(request.path).probe(request.path))})
        elif request.photo_flags is not None:
            _decode_photos(request.photo_flags, request, request.ring, records)
        else:
            _decode(request, request.ring, records)
    except StrandcastError as error:
        _send(records, {"error": vars(error)})
    except BrokenPipeError:
        pass
    except (MemoryError, OSError) as error:
        if isinstance(error, OSError) and error.errno != errno.ENOMEM:
            raise
        _send(records, {"memory": True})


def _send(records: int, record: Any) -> None:
    data = json.dumps(record).encode() + b"\n"
    while data:
        data = data[os.write(records, data) :]


def _limit_memory(extra_bytes: int) -> None:
    """Limit further memory growth, where the system supports it (macOS does not)."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except OSError:
        return
    limit = pages * os.sysconf("SC_PAGE_SIZE") + extra_bytes
    given, most = resource.getrlimit(resource.RLIMIT_AS)
    limits = [limit, *(each for each in (given, most) if each != resource.RLIM_INFINITY)]
    resource.setrlimit(resource.RLIMIT_AS, (min(limits), most))


def _limit_cpu(seconds: int) -> None:
    """Limit further CPU time; SIGXCPU then ends the process."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    most = resource.getrlimit(resource.RLIMIT_CPU)[1]
    limit = int(used.ru_utime + used.ru_stime) + seconds
    resource.setrlimit(
        resource.RLIMIT_CPU, (limit if most == resource.RLIM_INFINITY else min(limit, most), most)
    )


def _decode(request: Request, descriptor: int, records: int) -> None:
    with reader_of(request.path).open_source(request.path, request.threads, request.frames) as source:
        slots = _ring(source.info, descriptor)
        _send(records, {"info": vars(source.info) | {"path": request.path}, "slots": len(slots)})
        try:
            _fill(source, slots, request.cpu_s, records)
        except StrandcastError as error:
            _send(records, {"error": vars(error), "messages": source.messages()})
        else:
            _send(records, {"end": True, "messages": source.messages()})


def _decode_photos(flags: int, request: Request, descriptor: int, records: int) -> None:
    """Write each requested picture to the shared file; the parent copies it before it requests the next."""
    from strandcast.video.photo import decode_photo

    for line in sys.stdin.buffer:
        _limit_cpu(request.cpu_s)
        grey = decode_photo(json.loads(line), flags)
        if grey is not None:
            os.ftruncate(descriptor, grey.nbytes)
            with os.fdopen(descriptor, "r+b", closefd=False) as shared:
                shared.seek(0)
                shared.write(grey.data)
        _send(records, {"photo": None if grey is None else [grey.shape, grey.dtype.str]})


def _ring(info: VideoInfo, descriptor: int) -> list[memoryview]:
    """Map the shared memory and return its slots, one page-aligned frame each; the parent holds one."""
    each = slot_bytes(info)
    count = 1 + min(max(RING_BYTES // each, LEAST_SLOTS), MOST_SLOTS)
    os.ftruncate(descriptor, count * each)
    return slots_of(mmap.mmap(descriptor, count * each), info, count)


def slot_bytes(info: VideoInfo) -> int:
    """Return the size of a slot of the ring [bytes]: a frame, rounded up to whole pages."""
    return -(-info.frame_bytes // mmap.PAGESIZE) * mmap.PAGESIZE


def slots_of(ring: mmap.mmap, info: VideoInfo, count: int) -> list[memoryview]:
    """Return the memory of a ring's frames."""
    starts = (slot * slot_bytes(info) for slot in range(count))
    return [memoryview(ring)[start : start + info.frame_bytes] for start in starts]


def _fill(source: Source, slots: list[memoryview], cpu_s: int, records: int) -> None:
    free, sent = len(slots), 0
    for index, (time_s, raw) in enumerate(source.raws):
        if free == 0:
            free = len(os.read(0, len(slots)))
            if free == 0:
                raise BrokenPipeError
        free -= 1
        slot = slots[index % len(slots)]
        source.write(raw, slot)
        copy = index > 0 and is_copy(slot, slots[(index - 1) % len(slots)])
        messages = source.messages()[sent:]
        sent += len(messages)
        _send(records, [time_s, copy, messages])
        if index % REARM == 0:
            _limit_cpu(cpu_s)


if __name__ == "__main__":
    main()
