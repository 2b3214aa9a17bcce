"""Progress lines: on standard error, at most one every few seconds, and one when the work is complete."""

import subprocess
import sys

from strandcast.progress import Progress, print_line, progress
from strandcast.report.numbers import millimetres


def test_lines_are_rare_and_the_last_one_is_there(capsys) -> None:
    report = Progress("track", total=900, interval_s=60.0)
    report(300)
    report(900, "1 frame uncertain")
    assert capsys.readouterr().err == "track: 900/900  1 frame uncertain\n"


def test_items_pass_through(capsys) -> None:
    assert list(progress("ab", "letters", total=2)) == ["a", "b"]
    assert capsys.readouterr().err == "letters: 2/2\n"


def test_a_number_of_a_page_is_printed_with_spaces_that_a_search_finds(capsys) -> None:
    print_line(millimetres(0.0012, 0.0003))
    assert capsys.readouterr().err == "1.2 ± 0.3 mm\n"


def test_the_command_line_logs_to_standard_error_at_the_level_of_the_environment() -> None:
    code = (
        "import logging; from strandcast.cli.main import configure_logging; configure_logging()\n"
        "log = logging.getLogger('strandcast.records.record'); log.warning('w'); log.info('i')"
    )
    lines = []
    for level in ("", "info"):
        run = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=True,
            env={"STRANDCAST_LOG": level, "PYTHONPATH": ":".join(sys.path)},
        )
        lines.append(run.stderr.splitlines())
        assert run.stdout == ""
    assert lines[0] == ["warning: w"]
    assert lines[1] == [*lines[0], "INFO: i"]
