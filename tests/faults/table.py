"""The 95 faults of table.toml: run the tests that inject them, and print what came of each.

`make faults` calls this module. As a plug-in of pytest it notes for each test the codes of the errors that
were raised and, if the test fails, whether the fault was silent, ended in a traceback, or otherwise.
"""

import argparse
import ast
import inspect
import os
import re
import shutil
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from tests.faults.kinds import kind_of

from strandcast.errors import StrandcastError

FILE = Path(__file__).with_suffix(".toml")
ROOT = FILE.parents[2]
LAST_ROW = 95
CODE = re.compile(r"SC-[A-Z]\d{3}")
PROPERTY = "fault"
LARGE_FILES_BYTES = 15_000_000_000  # the tests of large files write 5 GB


class Row(NamedTuple):
    """One fault: how it is injected, what must come of it, and the tests that see to it."""

    number: int
    fault: str
    inject: str
    expect: str  # the codes of the errors, or what is flagged or healed
    unchanged: str = "raw files and earlier results"
    tests: tuple[str, ...] = ()
    reason: str = ""  # why it, or a part of it, is not injected here

    def codes(self) -> set[str]:
        """Return the codes that are expected."""
        return set(CODE.findall(self.expect))


def read_rows() -> list[Row]:
    """Return the rows of the table."""
    rows = tomllib.loads(FILE.read_text(encoding="utf-8"))["row"]
    return [Row(**row | {"tests": tuple(row.get("tests", ()))}) for row in rows]


def names_in(path: Path) -> set[str]:
    """Return the names of a file's tests, those in classes as `Class::test`."""
    found = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body if path.is_file() else []:
        if isinstance(node, ast.ClassDef):
            found |= {f"{node.name}::{each.name}" for each in node.body if isinstance(each, ast.FunctionDef)}
        elif isinstance(node, ast.FunctionDef):
            found.add(node.name)
    return found


def absent_tests(rows: list[Row]) -> list[str]:
    """Return the tests that rows name but that do not exist."""
    split = {test: test.partition("[")[0].partition("::") for row in rows for test in row.tests}
    known = {file: names_in(ROOT / file) for file, _, _ in split.values()}
    return [test for test, (file, _, name) in split.items() if name not in known[file]]


@dataclass
class Outcome:
    """What came of the tests of one row."""

    passed: int = 0
    failed: list[tuple[str, str]] = field(default_factory=list)  # kind, test
    skipped: set[str] = field(default_factory=set)  # reasons
    codes: set[str] = field(default_factory=set)

    def kind(self, row: Row) -> str:
        """Return how the row ended: as listed, silent, traceback, wrong, or not injected."""
        kinds = [kind for kind, _ in self.failed]
        if kinds:
            return next(kind for kind in ("traceback", "silent", "wrong") if kind in kinds)
        if not self.passed:
            return "not injected"
        return "as listed" if row.codes() <= self.codes else "wrong"

    def remark(self, row: Row) -> str:
        """Return why a row is not as listed, or was not injected, or only in part."""
        if self.failed:
            return ", ".join(sorted({test for _, test in self.failed}))
        missing = row.codes() - self.codes
        if self.passed and missing:
            return f"no test saw {', '.join(sorted(missing))}"
        return "; ".join([*([row.reason] if row.reason else []), *sorted(self.skipped)])


class Recorder:
    """Collects the reports of the tests; lives in the process that starts them."""

    def __init__(self) -> None:
        self.reports: list[tuple[str, Any]] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep a test's outcome, and a failure or skip of its fixtures."""
        if report.when == "call" or not report.passed:
            self.reports.append((report.nodeid, report))

    def outcome(self, row: Row) -> Outcome:
        """Return what came of a row's tests."""
        found = Outcome()
        for nodeid, report in self.reports:
            if any(nodeid == test or nodeid.startswith(f"{test}[") for test in row.tests):
                about = dict(report.user_properties).get(PROPERTY, {})
                found.codes |= set(about.get("codes", ()))
                if report.skipped:
                    found.skipped.add(str(report.longrepr[2]).removeprefix("Skipped: "))
                elif report.failed:
                    found.failed.append((about.get("kind", "wrong"), nodeid.rpartition("::")[2]))
                else:
                    found.passed += 1
        return found


_RAISED: set[str] = set()


def pytest_configure() -> None:
    """Note the code of every error that is made."""
    original = StrandcastError.__init__

    def noting(self: StrandcastError, code: str, *arguments: Any, **more: Any) -> None:
        _RAISED.add(code)
        original(self, code, *arguments, **more)

    StrandcastError.__init__ = noting  # type: ignore[method-assign]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[None]:
    """Add to a test's report which codes it saw, and how it failed."""
    report = yield
    if call.when == "setup" and call.excinfo is None:
        return report
    about: dict[str, Any] = {"codes": sorted(_RAISED | asserted(item))}
    _RAISED.clear()
    if call.excinfo is not None and not report.skipped:
        about["kind"] = kind_of(call.excinfo.value)
    report.user_properties.append((PROPERTY, about))
    return report


def asserted(item: pytest.Item) -> set[str]:
    """Return the codes that a test names: those of other processes are asserted by their words."""
    function = getattr(item, "function", None)
    given = getattr(getattr(item, "callspec", None), "params", {})
    return set(CODE.findall((inspect.getsource(function) if function else "") + repr(given)))


def main(arguments: list[str]) -> int:
    """Run the tests of the rows and print the table; 0 if all that were injected ended as listed."""
    parser = argparse.ArgumentParser(description="Other arguments are pytest's.")
    parser.add_argument("--rows", type=int, nargs="+", help="the numbers of the rows, instead of all")
    options, others = parser.parse_known_args(arguments)
    os.environ.setdefault("STRANDCAST_BOUNDS", "1")
    if shutil.disk_usage(tempfile.gettempdir()).free > LARGE_FILES_BYTES:
        os.environ.setdefault("STRANDCAST_LARGE_FILES", "1")
    rows = [row for row in read_rows() if not options.rows or row.number in options.rows]
    recorder = Recorder()
    if absent := absent_tests(rows):
        print("there is no such test:", *absent, sep="\n  ")
        return int(pytest.ExitCode.USAGE_ERROR)
    tests = sorted({test for row in rows for test in row.tests})
    code = pytest.main(["-p", "tests.faults.table", "-p", "no:cacheprovider", *others, *tests], [recorder])
    if code not in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
        return int(code)
    kinds = Counter(print_row(row, recorder.outcome(row)) for row in rows)
    tried = len(rows) - kinds["not injected"]
    figures = ", ".join(f"{kinds[kind]} {kind}" for kind in ("as listed", "wrong", "silent", "traceback"))
    print(f"\n{tried} of {len(rows)} faults injected: {figures}")
    return int(tried != kinds["as listed"])


def print_row(row: Row, outcome: Outcome) -> str:
    """Print one row and return how it ended."""
    kind, remark = outcome.kind(row), outcome.remark(row)
    print(f"{row.number:2}  {row.fault:46.46}  {row.expect:60.60}  {kind}{f' ({remark})' if remark else ''}")
    return kind


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
