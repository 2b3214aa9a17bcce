"""Run Snakemake: show what happens, and end it when this process is ended."""

import getpass
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Timer
from types import FrameType

from strandcast.errors import ENDING_SIGNALS, Ended
from strandcast.kernel_cache import COMPILED_AHEAD
from strandcast.workflow.display import Display

EVENT_LOG = (sys.executable, "-m", "strandcast.workflow.event_log")
COMPILING = "first run: the kernels of later stages are compiled on a second core meanwhile, once"
PATIENCE_S = 20.0  # chosen: stages end within a second, Snakemake within a few


def run_snakemake(
    line: list[str], root: Path, display: Display | None = None, program: Sequence[str] = EVENT_LOG
) -> int:
    """Run Snakemake and return its exit code.

    Parameters
    ----------
    line, root
        The command line, and the folder where it runs.
    display
        Shows what happens; by default, plain lines.
    program
        What runs for `snakemake`.

    Raises
    ------
    Ended
        A signal ended this process: Snakemake and its jobs have been ended with it.
    """
    display = display or Display()
    display.say(shlex.join(line))
    with (
        display.shown(),
        # In a session of its own: a signal of the terminal reaches it through this process, once.
        subprocess.Popen(
            [*program, *line[1:]],
            cwd=root,
            env=os.environ | _named_user(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,  # a dry run's list: the events hold the same
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,
        ) as engine,
        _passing_signals_to(engine, display) as received,
    ):
        assert engine.stderr is not None
        for words in engine.stderr:
            display.feed(words)
    if received:
        raise Ended(received[0], "all finished results are kept; the same command goes on from there")
    return engine.returncode


def _named_user() -> dict[str, str]:
    """Return a name for a user whom the system does not know, as in a container: Snakemake asks for it."""
    try:
        getpass.getuser()
    except (KeyError, OSError):
        return {"LOGNAME": f"user-{os.getuid()}"}
    return {}


@contextmanager
def compiling_ahead(cores: int, display: Display) -> Iterator[None]:
    """Compile kernels in a process of its own meanwhile, if that was never done and a core may be idle."""
    folder = os.environ.get("NUMBA_CACHE_DIR", "")
    if cores < 2 or Path(folder, COMPILED_AHEAD).exists():
        yield
        return
    display.say(COMPILING)
    line = [sys.executable, "-m", "strandcast.kernels_ahead"]
    nothing = subprocess.DEVNULL
    process = subprocess.Popen(line, stdin=nothing, stdout=nothing, stderr=nothing, start_new_session=True)
    try:
        yield
    finally:
        process.terminate()
        process.wait()


@contextmanager
def _passing_signals_to(engine: subprocess.Popen[str], display: Display) -> Iterator[list[int]]:
    """Interrupt the engine and its jobs when this process receives a signal; yield the signals received."""
    received: list[int] = []
    timers = [
        Timer(PATIENCE_S, _signal_group, (engine, signal.SIGTERM)),
        Timer(2.0 * PATIENCE_S, _signal_group, (engine, signal.SIGKILL)),
    ]

    def pass_on(number: int, frame: FrameType | None) -> None:
        received.append(number)
        display.stopped_by = signal.Signals(number).name
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
