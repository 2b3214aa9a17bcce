"""Snakemake with a logger of ours: `python -m strandcast.workflow.event_log` takes Snakemake's arguments.

Each event is one line of JSON on standard error, between the lines of the jobs, and begins with `MARK`.
"""

import json
import logging
import os
import re
import signal
import sys
import time
from collections.abc import Callable
from logging import WARNING, LogRecord
from pathlib import Path
from threading import Thread
from typing import Any

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.registry import LoggerPluginRegistry

from strandcast.errors import shortened
from strandcast.packages import broken_package
from strandcast.workflow.events import MARK, in_words

POLL_S = 0.5  # chosen
PATIENCE_S = 20.0  # as of a run that is stopped by a signal (`strandcast.workflow.engine`)
# What Slurm writes into the log of a job that it kills.
CAUSES = {
    "exceeded memory limit|oom.kill|Out Of Memory": ": out of memory",
    "DUE TO TIME LIMIT": ": out of time",
}


def _job_info(record: Any) -> dict[str, Any]:
    return {
        "id": record.jobid,
        "rule": record.rule_name,
        "wildcards": dict(record.wildcards),
        "reason": shortened(in_words(str(record.reason))),
    }


def _group_error(record: Any) -> dict[str, Any]:
    """Return which jobs of a group failed, by its log on the cluster; of a group that was killed, the first.

    Snakemake reports all jobs of a group as failed, those that were done or not begun too.
    """
    members = {info["jobid"]: info["rule_name"] for info in record.job_error_info}
    texts = [Path(log).read_text(errors="replace") for log in record.aux_logs if Path(log).is_file()]
    rules = {rule for text in texts for rule in re.findall(r"^Error in rule (\w+)", text, re.MULTILINE)}
    failed = [number for number, rule in members.items() if rule in rules] or list(members)[:1]
    stopped = [number for number in members if number not in failed]
    cause = next((words for sign, words in CAUSES.items() if re.search(sign, "".join(texts))), "")
    return {"failed": failed, "stopped": stopped, "cause": cause, "log": list(map(str, record.aux_logs))}


# What is passed on of the events of Snakemake's logger interface, by their names there.
EVENTS: dict[str, Callable[[Any], dict[str, Any]]] = {
    "run_info": lambda record: {"counts": dict(record.stats)},
    "job_info": _job_info,
    "job_finished": lambda record: {"id": record.job_id},
    "job_error": lambda record: {"id": record.jobid, "log": list(map(str, record.log))},
    "group_error": _group_error,
    "progress": lambda record: {"done": record.done, "total": record.total},
}


class LogHandler(LogHandlerBase):
    """The logger; Snakemake expects this name."""

    writes_to_stream = True
    writes_to_file = False
    has_filter = True
    has_formatter = True
    needs_rulegraph = False

    def emit(self, record: LogRecord) -> None:
        """Write an event that a run shows; errors and warnings of Snakemake itself are `message`."""
        name = str(getattr(record, "event", None))
        if name == "job_error" and getattr(record, "indent", False):  # of a group, which was reported before
            return
        if name in EVENTS:
            event = {"event": name} | EVENTS[name](record)
        elif record.levelno >= WARNING:
            event = {"event": "message", "text": shortened(record.getMessage())}
        else:
            return
        os.write(sys.stderr.fileno(), f"{MARK}{json.dumps(event)}\n".encode())


def end_with_parent() -> None:
    """End this process and its jobs when the run that started them is killed."""
    Thread(target=_end_without, args=(os.getppid(),), daemon=True).start()


def _end_without(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(POLL_S)
    # Nobody reads what is printed, and a broken pipe keeps Snakemake from ending.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())
    for number in (signal.SIGTERM, signal.SIGKILL):
        os.killpg(os.getpgrp(), number)
        time.sleep(PATIENCE_S)


def main() -> None:
    """Run Snakemake; if it is broken, end with one message."""
    try:
        from snakemake.cli import main as snakemake
    except Exception as error:
        problem = broken_package(error)
        if problem is None:
            raise
        print(problem, file=sys.stderr, flush=True)
        sys.exit(problem.exit_code)

    LoggerPluginRegistry().register_plugin("snakemake_logger_plugin_strandcast", sys.modules[__name__])
    end_with_parent()
    # Its own log file refuses the name of a folder that is not UTF-8, with a traceback for each line.
    logging.raiseExceptions = False
    sys.argv = ["snakemake", *sys.argv[1:], "--logger", "strandcast"]
    snakemake()


if __name__ == "__main__":
    main()
