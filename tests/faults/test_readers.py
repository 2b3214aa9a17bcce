"""Every reader of outside bytes on damaged files: one clear refusal, or a value; never a traceback.

STRANDCAST_FUZZ_CASES sets the number of cases of each reader. `make fuzz` runs more of them.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from strandcast.errors import StrandcastError
from strandcast.records.load import RECORDS, TABLES

from . import fuzzing
from .fuzzing import HEADS, Reader, fuzz
from .readers import readers, written

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")  # of the decoders
CASES = int(os.environ.get("STRANDCAST_FUZZ_CASES", "50"))


@pytest.mark.parametrize("reader", readers().values(), ids=readers())
def test_a_damaged_file_is_refused_or_read(tmp_path: Path, reader: Reader) -> None:
    tally = fuzz(reader, CASES, tmp_path)
    assert tally.tried == CASES
    assert tally.faults(reader) == [], f"{HEADS}\n{tally.line(reader.name)}"


def test_every_kind_of_record_and_table_is_damaged() -> None:
    kinds = {schema.rpartition("/")[2] for schema in (RECORDS | TABLES)}
    assert {name for name, reader in readers().items() if reader.sealed} > kinds


BROKEN: dict[str, Callable[[Path], Any]] = {
    "UnicodeDecodeError": lambda path: path.read_bytes().decode("ascii"),
    "read with another value": lambda path: path.read_bytes()[:1],
    "no end after": lambda path: path.read_bytes()[0] == ord("v") or [None for _ in iter(int, 1)],
    "a message that is too long": lambda path: path.read_bytes()[0] == ord("v") or refuse("x " * 5000),
}


def refuse(text: str) -> None:
    error = StrandcastError("SC-R001", "is damaged")
    error.what = text
    raise error


@pytest.mark.parametrize("words", BROKEN)
def test_a_reader_that_misbehaves_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    monkeypatch.setattr(fuzzing, "CPU_S", 0.2)
    reader = Reader("broken", written("file", "valid file"), BROKEN[words], sealed=True)
    assert any(words in fault for fault in fuzz(reader, 10, tmp_path).faults(reader))
