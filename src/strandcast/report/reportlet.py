"""One piece of a page: a figure with what it shows and found; or, where it failed, a box with the reason."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from markupsafe import Markup

from strandcast.errors import StrandcastError
from strandcast.report.drawing import drawing


@dataclass(frozen=True)
class Table:
    """A small table: heads and rows of text; cells may be markup."""

    heads: list[str]
    rows: list[list[Any]]
    caption: str = ""


@dataclass(frozen=True)
class Reportlet:
    """A figure or table of a page.

    Attributes
    ----------
    key
        Its name and anchor on the page.
    title, finding, reading
        What it is; one sentence computed from the data; what good and bad look like.
    markup
        The figure.
    tables
        What is told in numbers beside the figure.
    sources
        The files that it was made from, beside the page.
    problem
        Why there is no figure; None if there is one.
    """

    key: str
    title: str
    finding: str = ""
    reading: str = ""
    markup: Markup = field(default_factory=Markup)
    tables: list[Table] = field(default_factory=list)
    sources: list[str] = field(default_factory=list)
    problem: str | None = None


def attempt(key: str, title: str, build: Callable[..., Reportlet], *given: Any) -> Reportlet:
    """Return what `build` makes; whatever goes wrong becomes a box that says so, and the page stays whole."""
    try:
        with drawing():
            return build(key, title, *given)
    except StrandcastError as problem:
        return Reportlet(key, title, problem=problem.message())
    except Exception as problem:
        return Reportlet(key, title, problem=f"SC-H001 ERROR  {type(problem).__name__}: {problem}")
