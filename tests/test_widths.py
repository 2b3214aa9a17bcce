"""`make test-widths` runs tests with other settings of the libraries, and fails if one fails."""

import pytest

from . import widths

TEST = """
import os
def test_plain_numbers():
    assert os.environ.get("STRANDCAST_REGISTER_BITS") == "0"
    assert "OMP_NUM_THREADS" not in os.environ
"""


@pytest.mark.thorough
def test_a_failure_in_one_variant_is_in_the_table(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    (tmp_path / "test_bits.py").write_text(TEST)
    only = ["--tests", str(tmp_path), "-p", "no:cacheprovider", "--only"]
    assert widths.main([*only, "bits=0"]) == 0
    assert widths.main([*only, "bits=0 bits=128"]) == 1
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("bits=")]
    assert rows[-2:] == [["bits=0", "1", "0", "0"], ["bits=128", "0", "1", "0"]]


def test_an_unknown_variant_is_refused():
    with pytest.raises(SystemExit):
        widths.main(["--only", "bits=64"])
