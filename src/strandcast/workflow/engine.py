"""Run Snakemake: pass on its output without routine messages, and end it when this process is ended."""

import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Timer
from types import FrameType

from strandcast.errors import ENDING_SIGNALS, Ended

ROUTINE_MESSAGES = (
    "Using workflow specific profile",
    "Assuming unrestricted",
    "Building DAG",
    "Using shell",
    "Singularity",
    "Select jobs",
    "Execute ",
    "Complete log",
    "Elapsed time",
    "DAG of jobs will be updated",
    "Updating checkpoint",
)
PATIENCE_S = 20.0  # chosen: stages end within a second, Snakemake within a few


def run_snakemake(line: list[str], root: Path) -> int:
    """Run Snakemake and return its exit code.

    Raises
    ------
    Ended
        A signal ended this process: Snakemake and its jobs have been ended with it.
    """
    _say(shlex.join(line) + "\n")
    # Snakemake is installed beside this Python.
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    with (
        # In a session of its own: a signal of the terminal reaches it through this process, once.
        subprocess.Popen(
            line,
            cwd=root,
            env=os.environ | {"PATH": path},
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,
        ) as engine,
        _passing_signals_to(engine) as received,
    ):
        assert engine.stderr is not None
        for words in engine.stderr:
            if words.strip() and not words.startswith(ROUTINE_MESSAGES):
                _say(words)
    if received:
        raise Ended(received[0], "all finished results are kept; the same command goes on from there")
    return engine.returncode


@contextmanager
def _passing_signals_to(engine: subprocess.Popen[str]) -> Iterator[list[int]]:
    """Interrupt the engine and its jobs when this process receives a signal; yield the signals received."""
    received: list[int] = []
    timers = [
        Timer(PATIENCE_S, _signal_group, (engine, signal.SIGTERM)),
        Timer(2.0 * PATIENCE_S, _signal_group, (engine, signal.SIGKILL)),
    ]

    def pass_on(number: int, frame: FrameType | None) -> None:
        received.append(number)
        if len(received) == 1:
            _signal_group(engine, signal.SIGINT)
            for timer in timers:
                timer.daemon = True
                timer.start()

    heeded = [number for number in ENDING_SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    former = {number: signal.signal(number, pass_on) for number in heeded}
    try:
        yield received
        engine.wait()
    finally:
        for timer in timers:
            timer.cancel()
        for number, handler in former.items():
            signal.signal(number, handler)


def _signal_group(engine: subprocess.Popen[str], number: int) -> None:
    with suppress(ProcessLookupError):
        os.killpg(engine.pid, number)


def _say(text: str) -> None:
    with suppress(OSError):  # the terminal may be closed
        sys.stderr.write(text)
        sys.stderr.flush()
