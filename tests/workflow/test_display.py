"""What a run prints: a live table on a terminal, plain lines elsewhere, and never a garbled terminal."""

import json
import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable

import pytest
from tests.host_needs import needs_terminals

from strandcast.workflow.display import clock, printable
from strandcast.workflow.events import MARK

WILDCARDS = {"experiment": "rope", "trial": "01"}
BEGINS = {"event": "job_info", "id": 3, "rule": "track", "wildcards": WILDCARDS, "reason": ""}
COUNTS = {"event": "run_info", "counts": {"track": 1, "total": 1}}
ENDS = {"event": "job_finished", "id": 3}
FAILS = {"event": "job_error", "id": 3, "log": ["results/rope/track.log"]}
KILLED = "RuleException:\nCalledProcessError in file x:\nCommand 'y' returned non-zero exit status 137."

# A stand-in for Snakemake: it prints what it is given, then waits for a line or an interrupt.
ENGINE = """
import sys, time
for line in sys.argv[1].split("\\n"):
    print(line, file=sys.stderr, flush=True)
try:
    time.sleep(float(sys.argv[2]))
except KeyboardInterrupt:
    print("a traceback of no use", file=sys.stderr)
    sys.exit(1)
"""
RUN = """
import sys
from pathlib import Path
from strandcast.cli.main import guarded
from strandcast.workflow import engine
from strandcast.workflow.display import display_for
from strandcast.workflow.events import RunState
program = [sys.executable, "-c", *sys.argv[1:]]
guarded(lambda: sys.exit(engine.run_snakemake(["snakemake"], Path(), display_for(RunState()), program)))
"""


def command(*lines: str | dict, wait_s: float = 0.0) -> list[str]:
    text = "\n".join(line if isinstance(line, str) else MARK + json.dumps(line) for line in lines)
    return [sys.executable, "-c", RUN, ENGINE, text, str(wait_s)]


def in_pipe(*lines: str | dict) -> str:
    return subprocess.run(command(*lines), capture_output=True, text=True, check=False).stderr


def in_terminal(line: list[str], until: Callable[[str], bool] = lambda _: False) -> tuple[str, int]:
    """Run a command in a terminal, pressing Ctrl-C once `until` is true; return what it wrote, its status."""
    needs_terminals()
    pid, terminal = pty.fork()
    if pid == 0:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # a shell ignores it for jobs in the background
        os.environ.update(TERM="xterm-256color", COLUMNS="100", LINES="30")
        os.execv(line[0], line)
    shown, pressed, end = "", False, time.monotonic() + 60.0
    while time.monotonic() < end:
        if select.select([terminal], [], [], 0.1)[0]:
            try:
                shown += os.read(terminal, 65536).decode(errors="replace")
            except OSError:  # the other end is closed
                break
        if not pressed and until(shown):
            os.write(terminal, b"\x03")
            pressed = True
    _, status = os.waitpid(pid, 0)
    os.close(terminal)
    return shown, os.waitstatus_to_exitcode(status)


def test_a_pipe_gets_plain_lines():
    said = in_pipe(COUNTS, BEGINS, "rope trial-01 track: 3/9", "warning: odd", ENDS)
    assert said.splitlines()[1:] == ["rope trial-01 track: 3/9", "warning: odd"]
    assert "\x1b" not in said


def test_a_failed_stage_is_named_once_without_snakemakes_words():
    failure = {"event": "message", "text": KILLED.replace("137", "2")}
    last = {"event": "message", "text": "WorkflowError:\nAt least one job did not complete successfully."}
    said = in_pipe(BEGINS, "SC-V005 ERROR  video.mp4: is no video", failure, FAILS, last)
    assert said.splitlines()[1:] == [
        "SC-V005 ERROR  video.mp4: is no video",
        "rope trial-01: track failed; its log: results/rope/track.log",
    ]


def test_a_killed_stage_is_called_killed():
    assert "track failed: it was killed (SIGKILL)" in in_pipe(
        BEGINS, {"event": "message", "text": KILLED}, FAILS
    )


def test_an_error_of_snakemake_itself_is_shown():
    assert "no rule makes x" in in_pipe({"event": "message", "text": "no rule makes x"})


def test_a_terminal_shows_the_running_stages_and_its_cursor_returns():
    shown, code = in_terminal(command(COUNTS, BEGINS, "rope trial-01 track: 3/9", wait_s=1.0))
    assert code == 0
    assert "rope trial-01  track" in shown
    assert "3/9" in shown
    assert "0 of 1 stages" in shown
    assert shown.index("\x1b[?25l") < shown.rindex("\x1b[?25h")
    assert shown.count("\x1b[?25l") == shown.count("\x1b[?25h")


def test_a_finished_stage_stays_on_the_terminal():
    shown, _ = in_terminal(command(BEGINS, "warning: odd", ENDS, wait_s=0.5))
    assert "✓ rope trial-01  track  0:00" in shown
    assert "warning: odd" in shown


def test_ctrl_c_restores_the_cursor_and_says_how_to_go_on():
    shown, code = in_terminal(command(BEGINS, wait_s=50.0), lambda text: "rope trial-01" in text)
    assert code == 130
    assert shown.rindex("\x1b[?25h") > shown.rindex("\x1b[?25l")
    after = shown[shown.rindex("\x1b[?25h") :]
    assert "stopped by SIGINT: all finished results are kept; the same command goes on from there" in after
    assert "a traceback of no use" not in shown


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.2, "0:00"), (59.6, "1:00"), (3725, "1:02:05"), (-3, "0:00")]
)
def test_durations(seconds, text):
    assert clock(seconds) == text


def test_no_file_name_can_command_the_terminal():
    said = in_pipe("a\x1b]0;title\x07b\x1b[2Jc")
    assert "\x1b" not in said
    assert "\x07" not in said
    assert printable("tab\tand ü stay") == "tab\tand ü stay"
