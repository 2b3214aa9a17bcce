"""A write leaves the old file or the new one, never a part of it."""

import errno
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from strandcast.errors import StrandcastError
from strandcast.records.files import atomic_write, canonical_json, sha256_file, write_text


def test_a_failed_write_leaves_the_old_file_and_no_temporary_one(tmp_path):
    path = tmp_path / "result.json"
    write_text(path, "old")
    with pytest.raises(RuntimeError), atomic_write(path) as temporary:
        temporary.write_text("half of the n")
        raise RuntimeError
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]


def test_a_killed_writer_leaves_the_old_file_or_the_new(tmp_path):
    path = tmp_path / "result.txt"
    write_text(path, "0" * 200_000)
    code = (
        "import sys; from strandcast.records.files import write_text\n"
        "for k in range(10**6): write_text(sys.argv[1], str(k % 10) * 200_000)"
    )
    for pause_s in (0.05, 0.11, 0.17):
        writer = subprocess.Popen([sys.executable, "-c", code, str(path)])
        time.sleep(0.3 + pause_s)
        os.kill(writer.pid, signal.SIGKILL)
        writer.wait()
        text = path.read_text()
        assert len(text) == 200_000
        assert len(set(text)) == 1


def test_canonical_json_is_one_text_and_has_no_nan():
    assert canonical_json({"b": 0.1, "a": [1, "é"]}) == '{"a":[1,"é"],"b":0.1}'
    with pytest.raises(ValueError, match="JSON"):
        canonical_json(float("nan"))


def test_sha256_of_a_file(tmp_path):
    write_text(tmp_path / "abc", "abc")
    # FIPS 180-2, appendix B.1
    assert sha256_file(tmp_path / "abc") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


@pytest.mark.parametrize("number", [errno.EPERM, errno.ENOTSUP, errno.EINVAL])
def test_a_file_system_that_refuses_chmod_and_fsync_is_written_to(tmp_path, monkeypatch, number):
    def refuse(*_, **__):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", refuse)
    monkeypatch.setattr(Path, "chmod", refuse)
    write_text(tmp_path / "a.json", "text")
    assert (tmp_path / "a.json").read_text() == "text"


@pytest.mark.parametrize(
    ("number", "code", "words"),
    [
        (errno.EDQUOT, "SC-R041", "4 B needed, .* free on this disk, but your quota is used up"),
        (errno.EIO, "SC-W002", "Input/output error"),
        (errno.ESTALE, "SC-W002", "Stale file handle"),
    ],
)
def test_what_a_network_file_system_reports_at_last_is_an_error(tmp_path, monkeypatch, number, code, words):
    write_text(tmp_path / "a.json", "old")

    def fail(descriptor):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(StrandcastError, match=f"{code} ERROR  {tmp_path}/a.json: .*{words}"):
        write_text(tmp_path / "a.json", "text")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("a.json", "old")]


def test_a_limit_of_file_sizes_is_named(tmp_path):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, before[1]))
    try:
        with pytest.raises(
            StrandcastError, match="SC-R041.*2 MB needed, 1.05 MB allowed for a file"
        ) as caught:
            write_text(tmp_path / "a.json", 2_000_000 * "n")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "ulimit -f" in caught.value.message()
    assert list(tmp_path.iterdir()) == []


def test_an_error_of_another_file_stays_as_it_is(tmp_path):
    with pytest.raises(FileNotFoundError, match="absent"), atomic_write(tmp_path / "a.json"):
        (tmp_path / "absent").read_bytes()
    assert list(tmp_path.iterdir()) == []


def test_a_path_through_a_file_is_refused_by_name(tmp_path):
    (tmp_path / "file").write_text("text")
    with pytest.raises(
        StrandcastError, match=r"SC-W002 ERROR  .*file/a.json: cannot be written \((File exists|Not a)"
    ):
        write_text(tmp_path / "file" / "a.json", "text")
