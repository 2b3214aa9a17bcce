"""Signals reach the engine and its jobs, and the run says what was kept and how to go on."""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import NoReturn

import pytest
from tests.host_needs import needs_terminals
from tests.workflow.ending_signals import take_signals

from strandcast.workflow import engine

# A stand-in for Snakemake with one job: a process of its own, in a shell.
ENGINE = """
import subprocess, sys
print("demo trial-01 plan: 1/2", file=sys.stderr, flush=True)
job = subprocess.Popen(["bash", "-c", "sleep 600 & echo $! > {pids}; wait"])
try:
    job.wait()
except KeyboardInterrupt:
    job.wait()
    sys.exit(1)
"""
RUN = """
import sys
from pathlib import Path
from strandcast.cli.main import guarded
from strandcast.workflow import engine
engine.PATIENCE_S = 2.0
program = [sys.executable, "-c", sys.argv[1]]
guarded(lambda: sys.exit(engine.run_snakemake(["snakemake"], Path(), program=program)))
"""


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def start(
    tmp_path: Path, engine: str = ENGINE, sighup: signal.Handlers = signal.SIG_DFL
) -> tuple[subprocess.Popen, int]:
    """Start a run; return it and the process of its job."""
    pids = tmp_path / "pids"
    line = [sys.executable, "-c", RUN, engine.format(pids=pids)]
    run = subprocess.Popen(line, stderr=subprocess.PIPE, text=True, preexec_fn=partial(take_signals, sighup))
    while not pids.is_file() or not pids.read_text().strip():
        assert run.poll() is None
        time.sleep(0.02)
    return run, int(pids.read_text())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_every_way_to_end_a_run_ends_its_jobs_and_says_so(tmp_path, number):
    run, job = start(tmp_path)
    while "demo trial-01 plan: 1/2" not in run.stderr.readline():  # lines after the signal are lost
        assert run.poll() is None
    run.send_signal(number)
    _, said = run.communicate()
    assert run.returncode == 128 + number
    assert not alive(job)
    assert f"stopped by {number.name}: all finished results are kept" in said


def test_a_closed_terminal_ends_a_run_too(tmp_path):
    needs_terminals()
    master, slave = os.openpty()
    line = "import fcntl, os, sys, termios; os.setsid(); fcntl.ioctl(0, termios.TIOCSCTTY, 0); "
    line += "os.execv(sys.argv[1], sys.argv[1:])"
    pids = tmp_path / "pids"
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    run = subprocess.Popen(
        [sys.executable, "-c", line, sys.executable, "-c", RUN, ENGINE.format(pids=pids)],
        env=environment,
        stdin=slave,
        stdout=slave,
        stderr=slave,
        preexec_fn=take_signals,
    )
    os.close(slave)
    while not pids.is_file() or not pids.read_text().strip():
        time.sleep(0.02)
    os.close(master)
    assert run.wait() == 128 + signal.SIGHUP
    assert not alive(int(pids.read_text()))


def test_jobs_that_do_not_end_are_killed(tmp_path):
    stubborn = "import signal; [signal.signal(n, signal.SIG_IGN) for n in (2, 15)]\n" + ENGINE
    run, job = start(tmp_path, stubborn)
    run.send_signal(signal.SIGTERM)
    assert run.wait() == 128 + signal.SIGTERM
    assert not alive(job)
    run.stderr.close()


def test_a_run_under_nohup_goes_on_when_the_terminal_closes(tmp_path):
    run, job = start(tmp_path, sighup=signal.SIG_IGN)
    run.send_signal(signal.SIGHUP)
    time.sleep(0.3)
    assert run.poll() is None
    assert alive(job)
    run.send_signal(signal.SIGTERM)
    assert run.wait() == 128 + signal.SIGTERM
    run.stderr.close()


def test_the_engine_and_its_jobs_end_when_the_run_is_killed(tmp_path):
    watched = "from strandcast.workflow.event_log import end_with_parent; end_with_parent()\n" + ENGINE
    run, job = start(tmp_path, watched)
    run.kill()
    run.communicate()
    while alive(job):
        time.sleep(0.05)


def test_a_user_whom_the_system_does_not_know_has_a_name(monkeypatch, capfd):
    """As `docker run --user` has it; Snakemake asks for the name."""

    def unknown(number: int) -> NoReturn:
        raise KeyError(f"getpwuid(): uid not found: {number}")

    for name in ("LOGNAME", "USER", "LNAME", "USERNAME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("pwd.getpwuid", unknown)
    asking = "import getpass, sys; print('named', getpass.getuser(), file=sys.stderr)"
    assert engine.run_snakemake(["snakemake"], Path(), program=[sys.executable, "-c", asking]) == 0
    assert f"named user-{os.getuid()}" in capfd.readouterr().err
