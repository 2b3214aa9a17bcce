"""Threads for kernels that release the interpreter's lock: each thread runs a range of the candidates.

numba's own parallel loops would compile the body of each kernel three times more.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from itertools import pairwise

from numba import config

PARTS = 2  # ranges per thread, so that a thread on a busy core leaves work to the others (chosen)


class _Threads:
    """The threads of this process; a forked child starts its own."""

    def __init__(self) -> None:
        self.count: int = config.NUMBA_NUM_THREADS  # all cores, or the environment's NUMBA_NUM_THREADS
        self.pool: ThreadPoolExecutor | None = None

    def forget(self) -> None:
        self.pool = None


_threads = _Threads()
os.register_at_fork(after_in_child=_threads.forget)


def use_environment() -> None:
    """Take the number of threads from the environment again, which was changed after this module's import."""
    config.reload_config()
    _threads.count = config.NUMBA_NUM_THREADS


def over_ranges(count: int, kernel: Callable[[int, int], None]) -> None:
    """Call ``kernel(first, last)`` side by side on ranges that make up 0…count; raise the first error.

    The calling thread works too, and waits for no thread that has not begun: waking one takes as long as a
    small kernel.
    """
    threads = _threads.count
    parts = min(count, PARTS * threads)
    if threads == 1 or parts < 2:
        kernel(0, count)
        return
    if _threads.pool is None:
        _threads.pool = ThreadPoolExecutor(threads - 1, "kernel")
    ends = [count * part // parts for part in range(parts + 1)]
    ranges = iter(list(pairwise(ends)))  # each thread takes the next one

    def work() -> None:
        for first, last in ranges:
            kernel(first, last)

    others = [_threads.pool.submit(work) for _ in range(threads - 1)]
    try:
        work()
    finally:
        wait([other for other in others if not other.cancel()])
    for other in others:
        if not other.cancelled():
            other.result()


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Use this many threads within a block."""
    before, _threads.count, _threads.pool = _threads.count, count, None
    try:
        yield
    finally:
        _threads.count, _threads.pool = before, None
