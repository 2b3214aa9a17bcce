"""The table of faults is complete: every row has tests that exist, or the reason why it has none."""

from pathlib import Path

import pytest

from strandcast.errors import StrandcastError
from strandcast.errors.registry import read_codes

from .kinds import SilentFault, kind_of
from .table import LAST_ROW, Outcome, Row, absent_tests, read_rows

ROWS = read_rows()
PRINTED = "assert 'Traceback (most recent call last)' not in 'Traceback (most recent call last): ...'"


def test_the_rows_are_complete() -> None:
    assert [row.number for row in ROWS] == list(range(1, LAST_ROW + 1))
    assert [row.number for row in ROWS if not row.tests and not row.reason] == []
    assert [row.number for row in ROWS if not all((row.fault, row.inject, row.expect, row.unchanged))] == []


def test_the_tests_of_the_rows_exist() -> None:
    assert absent_tests(ROWS) == []
    wrong = "tests/faults/test_table.py::test_that_is_not_there"
    assert absent_tests([ROWS[0]._replace(tests=(wrong, "no/such_file.py::test"))]) == [
        wrong,
        "no/such_file.py::test",
    ]


def test_the_codes_of_the_rows_are_registered() -> None:
    codes = read_codes()[1]
    assert [(row.number, code) for row in ROWS for code in row.codes() if code not in codes] == []


def failure(kind: str, tmp_path: Path) -> BaseException:
    """Return the exception with which a test of this kind of failure ends."""
    with pytest.raises(BaseException) as caught:  # noqa: PT011
        if kind == "did not raise":
            with pytest.raises(StrandcastError):
                pass
        elif kind == "within the product":
            StrandcastError.message(None)  # type: ignore[arg-type]
        elif kind == "another error":
            raise StrandcastError("SC-V002", "another")
        elif kind == "in the test":
            (tmp_path / "absent").read_text()
        else:
            raise {
                "silent": SilentFault(),
                "printed": AssertionError(PRINTED),
                "assertion": AssertionError(),
            }[kind]
    return caught.value


@pytest.mark.parametrize(
    ("how", "kind"),
    [
        ("did not raise", "silent"),
        ("silent", "silent"),
        ("within the product", "traceback"),
        ("printed", "traceback"),
        ("another error", "wrong"),
        ("in the test", "wrong"),
        ("assertion", "wrong"),
    ],
)
def test_the_kinds_of_failure_are_distinguished(tmp_path: Path, how: str, kind: str) -> None:
    assert kind_of(failure(how, tmp_path)) == kind


def test_a_row_is_as_listed_only_with_its_codes_and_without_a_failure() -> None:
    row = Row(1, "a video is missing", "deleted", "SC-V020", tests=("a.py::test",))
    assert Outcome().kind(row) == "not injected"
    assert Outcome(passed=2, codes={"SC-V002"}).kind(row) == "wrong"
    assert Outcome(passed=2, codes={"SC-V002", "SC-V020"}).kind(row) == "as listed"
    failed = Outcome(passed=2, failed=[("wrong", "a"), ("silent", "b")], codes={"SC-V020"})
    assert failed.kind(row) == "silent"
    failed.failed.append(("traceback", "c"))
    assert failed.kind(row) == "traceback"
