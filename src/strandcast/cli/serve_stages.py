"""The server of `strandcast.workflow.stage_server`: it runs commands of strandcast in forks of itself.

A stage's modules are imported before its first fork, and are there for all that follow. Forks are safe as
the server has one thread, and does nothing but import. A request that a fork could not fulfil exactly as a
process of its own is refused: one from another folder, or with other settings in its environment. The client
then runs the command itself, as it does when it loses the server.
"""

import atexit
import ctypes
import gc
import os
import select
import selectors
import signal
import socket
import struct
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import NamedTuple, NoReturn

from strandcast.errors import ENDING_SIGNALS
from strandcast.stages.code_version import code_version
from strandcast.stages.declarations import STAGES
from strandcast.workflow.stage_client import NUMBER_BYTES

PARENT = 0  # standard input: a pipe that closes when Snakemake ends
PATIENCE_S = 10.0  # chosen: a client sends its request at once
LIBRARIES = ("OPENBLAS_", "MKL_", "BLIS_", "OMP_")  # `strandcast.cli` has set them
# Differ between jobs, and are read when they are needed, or again (`threads.use_environment`).
OF_A_JOB = {
    *("NUMBA_NUM_THREADS", "GOTO_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMEXPR_NUM_THREADS"),
    *("TMPDIR", "TMP", "TEMP", "TEMPDIR", "PATH", "PWD", "OLDPWD", "SHLVL", "_"),
    *("PS1", "PS2"),  # `activate` may export them; the shell of a job drops them
}
# jemalloc, which Arrow brings and does not use by default, would start a thread when it is loaded.
NO_ALLOCATOR_THREAD = ("JE_ARROW_MALLOC_CONF", "background_thread:false")
# What imports a library only when it is used, as every stage uses it.
LATER = {"pyarrow": "pandas"}
OUTPUT_LOST = 120  # Python's exit code
DIES_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl(2)


class StageRequest(NamedTuple):
    """A command: its arguments, environment and folder, and the client's standard streams."""

    arguments: list[str]
    environment: dict[str, str]
    folder: str
    streams: list[int]


class StageServer:
    """Accepts requests, forks, passes signals on, and reports how the forks have ended.

    A signal to the process group reaches forks by itself: it is passed on only if the server has not got it.
    """

    def __init__(self, listener: socket.socket) -> None:
        self.listener: socket.socket | None = listener
        self.jobs: dict[socket.socket, int] = {}  # the connection to a client, and the fork that serves it
        self.received: set[int] = set()
        # With which this process was started: importing this package adds to it.
        self.environment = _as_environment(Path("/proc/self/environ").read_bytes().split(b"\0"))
        self.folder = str(Path.cwd())
        self.dispositions = {number: signal.getsignal(number) for number in ENDING_SIGNALS}
        for number, before in self.dispositions.items():
            if before is not signal.SIG_IGN:
                signal.signal(number, self._note)
        self.wakes, wakeup = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(wakeup, warn_on_full_buffer=False)
        self.inputs = selectors.PollSelector()
        self._read(PARENT, self._stop_listening)
        self._read(listener, self._accept)
        self._read(self.wakes, lambda: os.read(self.wakes, select.PIPE_BUF))

    def _read(self, file: int | socket.socket, handle: Callable[[], object]) -> None:
        self.inputs.register(file, selectors.EVENT_READ, handle)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.received.add(number)

    def serve(self) -> None:
        """Run commands until Snakemake has ended, or a signal has come, and the last fork has ended."""
        while self.listener is not None or self.jobs:
            for key, _ in self.inputs.select():
                key.data()
            if self.received:
                self._stop_listening()
            self._reap()

    def _stop_listening(self) -> None:
        if self.listener is not None:
            for file in (PARENT, self.listener):
                self.inputs.unregister(file)
            self.listener.close()
            self.listener = None

    def _accept(self) -> None:
        if self.listener is None:  # closed since both were found to be readable
            return
        connection, _ = self.listener.accept()
        connection.settimeout(PATIENCE_S)
        streams: list[int] = []
        try:
            request = _receive(connection, streams)
            if request is not None and self._can_run(request):
                self._fork(request, connection)
        except (OSError, ValueError):  # a client that was killed, or is none; no more processes are allowed
            pass
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING_SIGNALS)
            for stream in streams:
                os.close(stream)
            if connection not in self.jobs:
                connection.close()

    def _can_run(self, request: StageRequest) -> bool:
        """Return whether a fork runs a command as a process of its own would; import what it needs."""
        names = self.environment.keys() | request.environment.keys()
        same = request.folder == self.folder and all(
            self.environment.get(name) == request.environment.get(name)
            for name in names - OF_A_JOB
            if not name.startswith(LIBRARIES)
        )
        return same and _imports(request.arguments[request.arguments[0] == "stage"])

    def _fork(self, request: StageRequest, connection: socket.socket) -> None:
        server = os.getpid()
        signal.pthread_sigmask(signal.SIG_BLOCK, ENDING_SIGNALS)  # the fork must not take one for the server
        pid = os.fork()
        if not pid:
            _run(request, partial(self._become_job, server))
        self.jobs[connection] = pid
        self._read(connection, partial(self._heed, connection, pid))

    def _become_job(self, server: int) -> None:
        """Give back what the fork has of the server, but not its connection: it ends when the fork ends."""
        ctypes.CDLL(None).prctl(DIES_WITH_PARENT, signal.SIGKILL)
        if os.getppid() != server:
            os._exit(1)
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for number, before in self.dispositions.items():
            signal.signal(number, before)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING_SIGNALS)
        if self.listener is not None:
            self.listener.close()
        for connection in self.jobs:
            connection.close()

    def _heed(self, connection: socket.socket, pid: int) -> None:
        """Pass a client's signals on to its fork; kill the fork if its client was killed."""
        try:
            numbers = connection.recv(1)
        except OSError:
            numbers = b""
        if not numbers:
            os.kill(pid, signal.SIGKILL)
            self.inputs.unregister(connection)
        elif numbers[0] not in self.received:
            os.kill(pid, numbers[0])

    def _reap(self) -> None:
        """Report forks that have ended to their clients."""
        for connection, pid in list(self.jobs.items()):
            ended, status = os.waitpid(pid, os.WNOHANG)
            if ended:
                code = os.waitstatus_to_exitcode(status)
                with suppress(OSError):
                    connection.sendall(code.to_bytes(NUMBER_BYTES, sys.byteorder, signed=True))
                with suppress(KeyError):  # its client was killed
                    self.inputs.unregister(connection)
                del self.jobs[connection]
                connection.close()


def _as_environment(items: list[bytes]) -> dict[str, str]:
    pairs = (os.fsdecode(item).partition("=") for item in items if item)
    return {name: value for name, _, value in pairs}


def _receive(connection: socket.socket, streams: list[int]) -> StageRequest | None:
    """Return a client's request; its standard streams are added to `streams`. None: not of this user.

    Raises
    ------
    OSError, ValueError
        The client is none.
    """
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    if struct.unpack("3i", credentials)[1] != os.getuid():
        return None
    head, received, _, _ = socket.recv_fds(connection, NUMBER_BYTES, 3)
    streams += received
    rest = int.from_bytes(head, sys.byteorder)
    data = bytearray()
    while len(data) < rest and (more := connection.recv(rest - len(data))):
        data += more
    folder, count, *words = bytes(data).split(b"\0")
    arguments = [os.fsdecode(word) for word in words[: int(count)]]
    if len(data) < rest or len(streams) != 3 or not arguments:
        raise ValueError(words)
    return StageRequest(arguments, _as_environment(words[int(count) :]), os.fsdecode(folder), streams)


def _imports(command: str) -> bool:
    """Import what a command needs; return whether this process is still fit to be forked."""
    stage = command.replace("-", "_")
    modules = ["strandcast.cli.app", *([f"strandcast.stages.{stage}"] if stage in STAGES else [])]
    for module in modules:
        if module not in sys.modules:
            with suppress(Exception):  # the fork meets the same error, and reports it
                import_module(module)
            modules += [later for user, later in LATER.items() if user in sys.modules]
            if stage in STAGES:  # of the code that was imported, whatever is edited while it is used
                code_version(stage)
            gc.freeze()  # collections in the forks would copy its memory
    return len(list(Path("/proc/self/task").iterdir())) == 1


def _run(request: StageRequest, become_job: Callable[[], None]) -> NoReturn:
    """Run a command in this fork, and end it as Python ends."""
    code = 1
    try:
        become_job()
        for number, stream in enumerate(request.streams):
            os.dup2(stream, number)
            os.close(stream)
        os.environ.update(
            {name: value for name, value in request.environment.items() if not name.startswith(LIBRARIES)}
        )
        if "strandcast.threads" in sys.modules:
            sys.modules["strandcast.threads"].use_environment()
        sys.orig_argv = [sys.executable, "-m", "strandcast", *request.arguments]
        sys.argv = [str(Path(__file__).parents[1] / "__main__.py"), *request.arguments]
        code = _run_main()
        threading._shutdown()  # type: ignore[attr-defined]  # waits for threads, and ends their pools
        atexit._run_exitfuncs()
    finally:
        os._exit(_flushed(code))


def _run_main() -> int:
    """Run the command of `sys.argv` and return its exit code."""
    from strandcast.cli.main import main

    try:
        main()
    except SystemExit as end:
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr)
        return end.code & 0xFF if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        sys.excepthook(*sys.exc_info())
        return 1
    return 0


def _flushed(code: int) -> int:
    """Flush what was printed and return the exit code, Python's own if that is impossible."""
    try:
        sys.stderr.flush()
        sys.stdout.flush()
    except OSError:
        return code or OUTPUT_LOST
    return code


def serve(listener: socket.socket) -> None:
    """Serve the clients of a socket until this process's parent ends."""
    os.environ.setdefault(*NO_ALLOCATOR_THREAD)
    StageServer(listener).serve()


if __name__ == "__main__":
    serve(socket.socket(fileno=int(sys.argv[1])))
