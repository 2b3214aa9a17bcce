"""The examination of the computer: what is fine, what is a problem, and its fix."""

import errno
import importlib.metadata
import json
from pathlib import Path

import pytest
import typer

from strandcast.cli import checks as command
from strandcast.video import self_test
from strandcast.workflow import doctor
from strandcast.workflow.project import make_project


def states(found) -> dict[str, str]:
    return {each.name: each.state for each in found}


def test_this_computer_can_run_strandcast(tmp_path, monkeypatch, capsys):
    make_project(tmp_path / "lab")
    monkeypatch.setattr(command, "ROOT", tmp_path / "lab")
    with pytest.raises(typer.Exit) as end:
        command.doctor(as_json=True)
    found = [doctor.Diagnosis(**each) for each in json.loads(capsys.readouterr().out)["checks"]]
    assert [each for each in found if each.state == "problem"] == []
    assert end.value.exit_code == 0
    assert states(found)["codec h264"] == states(found)["codec mjpeg"] == states(found)["project"] == "ok"
    (packages,) = [each.found for each in found if each.name == "packages" and each.state == "ok"]
    assert f"numpy {importlib.metadata.version('numpy')}" in packages


def test_closed_shared_memory_is_no_problem(monkeypatch, tmp_path):
    def refuse(method: str) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(doctor, "get_context", refuse)
    (found,) = doctor._shared_memory(tmp_path)
    assert (found.state, found.found) == ("note", "closed: /dev/shm: Permission denied")
    assert "--report-only uses one core" in found.fix


def test_a_sound_computer_is_accepted_before_a_run(tmp_path):
    (tmp_path / "results" / "a").mkdir(parents=True)
    doctor.check_host(tmp_path, ["a", "not-begun"])
    assert not (tmp_path / "results" / "not-begun").exists()


def test_a_codec_that_does_not_decode_is_a_problem(monkeypatch, tmp_path):
    monkeypatch.setattr(self_test, "_encoded", lambda clip, levels: b"no video")
    found = list(doctor._codecs(tmp_path))
    assert {each.state for each in found} == {"problem"}
    assert all(each.fix for each in found)


def test_frames_that_differ_are_noticed(monkeypatch):
    monkeypatch.setattr(self_test, "_decoded", lambda data, codec: [40.0] * self_test.FRAMES)
    assert self_test.decode_problem("mjpeg") == "decoded frames differ by 160 grey levels"


def test_packages_are_compared_with_the_pinned_ones(monkeypatch, tmp_path):
    has = importlib.metadata.version("numpy")
    monkeypatch.setattr(doctor, "_requirements", lambda: ["numpy>=1", "nowhere-to-be-found"])
    monkeypatch.setattr(doctor, "_lock", lambda: "numpy==0.1 \\\n  --hash=sha256:0\n")
    missing, other = doctor._packages(tmp_path)
    assert (missing.state, missing.found) == ("problem", "missing: nowhere-to-be-found")
    assert (other.state, other.found) == ("note", f"not as pinned: numpy {has}, not 0.1")
    monkeypatch.setattr(doctor, "_requirements", lambda: ["numpy"])
    monkeypatch.setattr(doctor, "_lock", lambda: f"numpy==0.1 ; python_version < '3'\nnumpy=={has}\n")
    assert states(doctor._packages(tmp_path)) == {"packages": "ok"}


@pytest.mark.parametrize(("free", "state"), [(1 << 29, "problem"), (2 << 30, "note"), (8 << 30, "ok")])
def test_memory_is_compared_with_what_stages_need(monkeypatch, tmp_path, free, state):
    monkeypatch.setattr(doctor, "_free_memory", lambda: free)
    assert states(doctor._memory(tmp_path)) == {"memory": state}


def test_a_full_disk_is_a_problem(monkeypatch, tmp_path):
    monkeypatch.setattr(doctor, "free_bytes", lambda place: 1000)
    assert set(states(doctor._disk(tmp_path)).values()) == {"problem"}


def test_kernels_are_counted_and_must_be_kept(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    (empty,) = doctor._kernels(tmp_path)
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "dynamics.chain_torques-.py311.nbi").write_bytes(b"12345")
    (one,) = doctor._kernels(tmp_path)
    assert empty.found.startswith("0 compiled")
    assert one.found.startswith("1 compiled, 5 B at")
    count = [int(each.found.split("; ")[1].split()[0]) for each in (empty, one)]
    assert count[0] - count[1] == 1
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    assert states(doctor._kernels(tmp_path)) == {"kernels": "problem"}


def test_a_driver_that_cannot_be_imported_is_a_problem(monkeypatch, tmp_path):
    monkeypatch.setattr(doctor, "DRIVERS", {"ur": ("numpy", "no_such_module")})
    (found,) = doctor._drivers(tmp_path)
    assert found.state == "problem"
    assert "no_such_module" in found.found


def test_a_check_that_fails_does_not_hide_the_others(monkeypatch, tmp_path):
    def _broken(root: Path):
        raise RuntimeError("odd")

    monkeypatch.setattr(doctor, "CHECKS", (_broken, doctor._python))
    assert states(doctor.diagnose(tmp_path)) == {"broken": "problem", "python": "ok"}
