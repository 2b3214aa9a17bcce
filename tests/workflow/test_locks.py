"""Leases: one run at a time; dead owners on this host and on others are recognised, living ones never."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from strandcast.errors import StrandcastError
from strandcast.records.files import write_text
from strandcast.workflow import locks

SHORT_LEASE_S = 3.0
HOLD = f"""
import sys, time
from pathlib import Path
from strandcast.workflow import locks
locks.LEASE_S = {SHORT_LEASE_S}
locks.hold_until_exit(Path(sys.argv[1]), ["demo"])
print("held", flush=True)
time.sleep(float(sys.argv[2]))
"""


def holder(root: Path, *before: str, seconds: float = 600.0) -> subprocess.Popen:
    """Start a process that holds the lease of demo; `before` starts it, e.g. on another host."""
    line = [*before, sys.executable, "-c", HOLD, str(root), str(seconds)]
    process = subprocess.Popen(line, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "held\n"
    return process


def end(process: subprocess.Popen, number: int = signal.SIGKILL) -> None:
    process.send_signal(number)
    process.wait()
    process.stdout.close()


@pytest.fixture(autouse=True)
def short_lease(monkeypatch):
    monkeypatch.setattr(locks, "LEASE_S", SHORT_LEASE_S)
    monkeypatch.delenv(locks.WITHIN_WORKFLOW, raising=False)


def other_host() -> list[str]:
    """Return the command that runs another one with another host name, or skip the test."""
    before = ["unshare", "--uts", "sh", "-c", 'hostname elsewhere && exec "$@"', "sh"]
    if shutil.which("unshare") is None or subprocess.run([*before, "true"], capture_output=True).returncode:
        pytest.skip("this machine does not allow another host name")
    return before


def test_a_second_run_is_refused_and_names_the_holder(tmp_path):
    first = holder(tmp_path)
    with pytest.raises(StrandcastError, match=f"SC-W010.*process {first.pid} on .* since 20") as refused:
        locks.take(tmp_path, "demo")
    assert "wait for it to end" in refused.value.fix
    locks.hold_until_exit(tmp_path, ["another"])  # another experiment is free
    end(first, signal.SIGTERM)


def test_two_folders_that_share_their_results_are_one(tmp_path):
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
    (tmp_path / "here" / "results").mkdir()
    (tmp_path / "there" / "results").symlink_to(tmp_path / "here" / "results")
    first = holder(tmp_path / "here")
    with pytest.raises(StrandcastError, match=f"SC-W010.*process {first.pid} on"):
        locks.take(tmp_path / "there", "demo")
    end(first)


def test_all_leases_or_none(tmp_path):
    first = holder(tmp_path)
    with pytest.raises(StrandcastError, match="SC-W010"):
        locks.hold_until_exit(tmp_path, ["alpha", "demo"])
    assert not (tmp_path / "results/alpha/.lease").exists()
    end(first)


def test_a_killed_owner_on_this_host_is_recognised_at_once(tmp_path, capsys):
    end(holder(tmp_path))
    with locks.lease(tmp_path, "demo"):
        assert locks.owner_of(tmp_path, "demo").pid == os.getpid()
    assert capsys.readouterr().err == ""  # it says so before it waits
    assert not list((tmp_path / "results/demo").iterdir())


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_a_killed_owner_whose_parent_does_not_know_is_recognised(tmp_path):
    first = holder(tmp_path)
    first.kill()
    os.waitid(os.P_PID, first.pid, os.WEXITED | os.WNOWAIT)  # it has ended, and stays a zombie
    with locks.lease(tmp_path, "demo"):
        assert locks.owner_of(tmp_path, "demo").pid == os.getpid()
    end(first)


@pytest.mark.parametrize("content", ["", pytest.param("filelock", marks=pytest.mark.thorough)])
@pytest.mark.parametrize("owner_known", [pytest.param(True, marks=pytest.mark.thorough), False])
def test_a_lease_whose_owner_was_killed_while_it_wrote_its_name_is_taken_over(tmp_path, content, owner_known):
    end(holder(tmp_path))
    (tmp_path / "results/demo/.lease").write_text(content)
    if not owner_known:
        (tmp_path / "results/demo/.lease-owner.json").unlink()
    with locks.lease(tmp_path, "demo"):
        assert locks.owner_of(tmp_path, "demo").pid == os.getpid()


def test_a_killed_owner_on_another_host_is_recognised_by_its_lease(tmp_path, capsys):
    end(holder(tmp_path, *other_host()))
    held = locks.take(tmp_path, "demo")
    assert "on elsewhere since" in capsys.readouterr().err
    held.release()


def test_a_living_owner_on_another_host_is_waited_for_and_never_robbed(tmp_path):
    first = holder(tmp_path, *other_host())
    began = time.monotonic()
    with pytest.raises(StrandcastError, match="SC-W010.*on elsewhere"):
        locks.take(tmp_path, "demo")
    assert time.monotonic() - began > SHORT_LEASE_S
    with pytest.raises(StrandcastError, match="SC-W010.*on elsewhere"):
        locks.unlock(tmp_path, "demo")
    end(first)


def test_unlock_refuses_while_the_owner_lives(tmp_path):
    assert locks.unlock(tmp_path, "demo") == "demo: no run holds it"
    first = holder(tmp_path)
    with pytest.raises(StrandcastError, match="SC-W010"):
        locks.unlock(tmp_path, "demo")
    pid = first.pid
    end(first)
    assert locks.unlock(tmp_path, "demo").startswith(f"demo: released; it was held by process {pid} on ")


def test_jobs_of_a_workflow_rely_on_its_lease(tmp_path, monkeypatch):
    first = holder(tmp_path)
    monkeypatch.setenv(locks.WITHIN_WORKFLOW, "1")
    with locks.lease(tmp_path, "demo"):
        pass
    end(first)


def test_temporary_files_of_killed_writers_are_removed(tmp_path):
    folder = tmp_path / "results/demo/trial-01"
    for name in (".track.k3j.tmp.parquet", "track.parquet", ".nfs0001"):
        write_text(folder / name, "x")
    with locks.lease(tmp_path, "demo"):
        assert sorted(path.name for path in folder.iterdir()) == [".nfs0001", "track.parquet"]
