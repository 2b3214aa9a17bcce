"""A write leaves the old file or the new one, never a third thing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from strandcast.records.files import atomic_write, canonical_json, sha256_file, write_text


def test_a_failed_write_leaves_the_old_file_and_no_litter(tmp_path):
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
