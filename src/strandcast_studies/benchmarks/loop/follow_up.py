"""Further measurements on experiments that `loop.run --work WORK` has made."""

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from strandcast_studies.benchmarks.loop.run import PROJECT, cases_of, loop_parser
from strandcast_studies.paper.cases import FILE, load_plan

Rows = list[dict[str, Any]]
SEEDS = [2001, 2002, 2003]  # the first of the reported ones


def follow_up_parser(description: str | None, out: str) -> argparse.ArgumentParser:
    """Return the command-line options that all follow-ups share."""
    parser = loop_parser(description, SEEDS, out)
    parser.add_argument("root", type=Path, help="WORK/VARIANT/RIG of an earlier run")
    return parser


def follow_up(
    description: str | None,
    out: str,
    rows_of: Callable[[Path, str], Rows],
    summary_of: Callable[[Rows], Any],
    arguments: list[str] | None,
) -> None:
    """Measure the chosen experiments one by one; rewrite the file of rows and summary after each."""
    options = follow_up_parser(description, out).parse_args(arguments)
    rows: Rows = []
    options.out.parent.mkdir(parents=True, exist_ok=True)
    for case in cases_of(load_plan(PROJECT / FILE), options.strings, options.seeds, "default"):
        rows += rows_of(options.root, case.name)
        text = json.dumps({"summary": summary_of(rows), "rows": rows}, indent=1)
        options.out.write_text(text, encoding="utf-8")
        print(case.name, file=sys.stderr)
    print(json.dumps(summary_of(rows), indent=1))
