"""A command that a fork of the stage server runs behaves as a process of its own, and nothing of it stays."""

import os
import platform
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from tests.workflow.ending_signals import take_signals

from strandcast.records.folders import WITHIN_WORKFLOW
from strandcast.stages.declarations import STAGES
from strandcast.workflow import stage_server

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="there is a server on Linux only")

# Serves commands of Python instead of strandcast's: `COMMAND CODE`. Run directly, they are refused.
SERVING = """
import socket, sys
from strandcast.cli import main, serve_stages
main.main = lambda: exec(sys.argv[2], {})
serve_stages.serve(socket.socket(fileno=int(sys.argv[1])))
"""
# Starts a server and then waits, as Snakemake does.
PARENT = """
import sys, time
from strandcast.workflow import stage_server
stage_server.SERVER = "serving"
print(stage_server.start(), flush=True)
time.sleep(600)
"""
COUNT = """
import signal, sys, time
signals = []
for number in (2, 15):
    signal.signal(number, lambda number, _: signals.append(number))
print("ready", flush=True)
until = time.monotonic() + 60
while not signals and time.monotonic() < until:
    time.sleep(0.01)
time.sleep(0.3)
sys.exit(10 * len(signals) + sum(set(signals)))
"""
WAIT = "import time; print('ready', flush=True); time.sleep(600)"
KERNELS = """from threadpoolctl import threadpool_info
print(*{info["architecture"] for info in threadpool_info() if info["internal_api"] == "openblas"})"""
REFUSED = 2  # by strandcast itself, which has no such command


class Parent:
    """A process with a server, and the commands that are run by that."""

    def __init__(self, folder: Path) -> None:
        (folder / "serving.py").write_text(SERVING)
        self.folder = folder
        path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
        self.environment = os.environ | {"PYTHONPATH": path, WITHIN_WORKFLOW: "1"}
        self.process = subprocess.Popen(
            [sys.executable, "-c", PARENT],
            cwd=folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=take_signals,
        )
        assert self.process.stdout is not None
        line = shlex.split(self.process.stdout.readline())
        assert line[0] == "python"
        self.line = [sys.executable, *line[1:]]
        (self.server,) = psutil.Process(self.process.pid).children()

    def start(self, code: str, command: str = "nothing", folder: Path | None = None, **variables: str):
        """Start a command, in the group of the server; its output can be read."""
        return subprocess.Popen(
            [*self.line, command, code],
            cwd=folder or self.folder,
            env=self.environment | variables,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            process_group=None,
        )

    def run(self, code: str, command: str = "nothing", given: str = "", **variables) -> tuple[int, str, str]:
        """Run a command; return its exit code and what it printed."""
        job = self.start(code, command, **variables)
        out, errors = job.communicate(given, timeout=120)
        return job.returncode, out, errors

    def ready(self, code: str) -> subprocess.Popen:
        """Start a command and wait until it prints that it is ready."""
        job = self.start(code)
        assert job.stdout.readline() == "ready\n"
        return job

    def fork(self) -> psutil.Process:
        """Return the only fork."""
        (fork,) = self.server.children()
        return fork

    def end(self) -> None:
        """Kill all."""
        for process in (self.server, self.process):
            process.kill()
        self.process.communicate()


@pytest.fixture
def parent(tmp_path) -> Iterator[Parent]:
    started = Parent(tmp_path)
    yield started
    started.end()


def gone(process: psutil.Process) -> bool:
    """Return whether a process ends within a minute; one that nobody waits for stays as a zombie."""
    until = time.monotonic() + 60
    while time.monotonic() < until:
        if not process.is_running() or process.status() == psutil.STATUS_ZOMBIE:
            return True
        time.sleep(0.02)
    return False


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the kernels are those of x86-64")
@pytest.mark.parametrize("own", ["Nehalem", None])
def test_only_a_variable_of_strandcasts_own_chooses_the_kernels_of_openblas(tmp_path, monkeypatch, own):
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Prescott")  # for processors from before x86-64-v2
    monkeypatch.delenv("STRANDCAST_OPENBLAS_CORETYPE", raising=False)
    if own:
        monkeypatch.setenv("STRANDCAST_OPENBLAS_CORETYPE", own)
    parent = Parent(tmp_path)
    try:
        code, of_job, errors = parent.run(f"import scipy.linalg; {KERNELS}", "estimate")
    finally:
        parent.end()
    assert code == 0, errors
    line = [sys.executable, "-c", f"import strandcast.cli.main, scipy.linalg; {KERNELS}"]
    of_command = subprocess.run(line, capture_output=True, text=True, check=True).stdout
    assert of_job == of_command
    assert of_job == "Nehalem\n" if own else of_job not in ("Prescott\n", "Katmai\n", "\n")


def test_a_fork_prints_reads_and_ends_as_a_process_of_its_own(parent):
    code = "import sys; print(sys.stdin.read(), sys.argv[1:]); print('no', file=sys.stderr); sys.exit(7)"
    assert parent.run(code, given="yes") == (7, f"yes {['nothing', code]}\n", "no\n")
    assert parent.run("pass")[0] == 0
    assert parent.run("import sys; sys.exit('broken')") == (1, "", "broken\n")
    code, _, errors = parent.run("raise ValueError('here')")
    assert code == 1
    assert errors.startswith("Traceback")
    assert errors.endswith("ValueError: here\n")
    late = "import atexit, threading, time; atexit.register(print, 2); "
    late += "threading.Thread(target=lambda: (time.sleep(0.1), print(1))).start()"
    assert parent.run(late)[:2] == (0, "1\n2\n")


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGABRT, signal.SIGTERM])
def test_a_fork_that_a_signal_ends_ends_its_client_by_it(parent, number):
    no_core = "import os, resource; resource.setrlimit(resource.RLIMIT_CORE, (0, 0)); "
    assert parent.run(f"{no_core} os.kill(os.getpid(), {number:d})")[0] == -number


def test_what_a_fork_does_stays_in_it(parent):
    assert parent.run("import os; os.environ['A'] = 'b'; os.chdir('/'); os.nice(3); import wave")[0] == 0
    told = "import os, sys; print(os.environ.get('A'), os.getcwd(), os.nice(0), 'wave' in sys.modules)"
    assert parent.run(told)[1] == f"None {parent.folder} {os.nice(0)} False\n"


def test_threads_are_those_of_the_job(parent):
    code = "from strandcast import threads; print(threads._threads.count)"
    found = [parent.run(code, "plan", NUMBA_NUM_THREADS=number)[1] for number in ("1", "2", "1")]
    assert found == ["1\n", "2\n", "1\n"]


def test_the_server_has_one_thread_and_every_stage_imported(parent):
    for stage in STAGES:
        shown = f"import sys; print('strandcast.stages.{stage}' in sys.modules, 'wave' in sys.modules)"
        assert parent.run(shown, stage.replace("_", "-"))[:2] == (0, "True False\n")
        assert parent.server.num_threads() == 1, stage


def test_other_folders_and_environments_are_left_to_a_process_of_its_own(parent, tmp_path_factory):
    assert parent.run("print(1)", TMPDIR="/tmp", OMP_NUM_THREADS="7")[:2] == (0, "1\n")
    assert parent.run("print(1)", MPLBACKEND="svg")[:2] == (REFUSED, "")
    assert parent.run("print(1)", folder=tmp_path_factory.mktemp("elsewhere"))[:2] == (REFUSED, "")
    parent.server.kill()
    assert parent.run("print(1)")[:2] == (REFUSED, "")


def test_a_module_that_starts_a_thread_ends_the_service(parent):
    broken = "import threading, time\nthreading.Thread(target=time.sleep, args=(600,), daemon=True).start()\n"
    (parent.folder / "sitecustomize.py").write_text(broken)
    other = Parent(parent.folder)
    assert other.run("print(1)")[:2] == (REFUSED, "")
    other.end()


def test_a_signal_to_a_client_or_to_all_reaches_the_fork_once(parent):
    job = parent.ready(COUNT)
    job.send_signal(signal.SIGTERM)
    assert job.wait() == 10 + signal.SIGTERM
    job = parent.start(COUNT)
    assert job.stdout.readline() == "ready\n"
    for process in (parent.fork().pid, parent.server.pid, job.pid):  # a group, in the order of the kernel
        os.kill(process, signal.SIGINT)
    assert job.wait() == 10 + signal.SIGINT
    assert gone(parent.server)  # a run that is stopped starts no more jobs


def test_a_killed_client_kills_its_fork_alone(parent):
    other = parent.ready(WAIT)
    fork = parent.fork()
    job = parent.ready(WAIT)
    (mine,) = set(parent.server.children()) - {fork}
    job.kill()
    assert gone(mine)
    assert fork.is_running()
    assert parent.run("print(1)")[:2] == (0, "1\n")
    other.kill()


def test_a_killed_server_kills_its_forks_and_the_command_is_run_directly(parent):
    job = parent.ready(WAIT)
    fork = parent.fork()
    parent.server.kill()
    assert job.wait() == REFUSED
    assert gone(fork)


def test_a_server_ends_with_its_parent_after_its_last_fork(parent):
    job = parent.ready("import time; print('ready', flush=True); time.sleep(2); print('done')")
    parent.process.kill()
    assert job.communicate()[0] == "done\n"
    assert job.returncode == 0
    assert gone(parent.server)


def test_a_parent_that_ends_by_itself_takes_its_server_with_it(tmp_path):
    code = "import psutil; from strandcast.workflow.stage_server import start; start(); "
    code += "print(psutil.Process().children()[0].pid)"
    line = [sys.executable, "-c", code]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert not psutil.pid_exists(int(done.stdout))


def test_elsewhere_than_on_linux_there_is_no_server(monkeypatch):
    monkeypatch.setattr(sys, "platform", "darwin")
    assert stage_server.start() == stage_server.DIRECTLY
