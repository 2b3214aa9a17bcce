"""Pages from templates: escaped, strict about names, one file without external resources."""

import base64
import csv
import hashlib
import io
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from strandcast.core.trial_names import trial_name
from strandcast.errors import StrandcastError
from strandcast.report import numbers
from strandcast.report.typeset import typeset

LARGEST_BYTES = 1_500_000  # of a picture within a page


def render(
    template: str, package: str = "strandcast.report", script: str = "viewer.js.jinja", **values: Any
) -> str:
    """Return a page; a name that the template uses but did not get is an error.

    `script` is the template of the one script that its policy lets run, if the page has one.
    """
    environment = _environment(package)
    code = page_script(script)
    return environment.get_template(template).render(
        script=Markup(code),
        script_hash=base64.b64encode(hashlib.sha256(code.encode()).digest()).decode(),
        style=Markup(environment.get_template("style.css.jinja").render()),
        **values,
    )


@cache
def _environment(package: str) -> Environment:
    """Return the templates of a package and of the report, compiled once a process."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package), PackageLoader("strandcast.report")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["mm"] = numbers.millimetres
    environment.filters["ms"] = numbers.milliseconds
    environment.filters["percent"] = numbers.percent
    environment.filters["place"] = numbers.place
    environment.filters["trial_name"] = trial_name
    environment.filters["typeset"] = typeset
    environment.filters["csv_link"] = csv_link
    return environment


def embedded(picture: bytes, file: str | Path, fix: str | None = None) -> Markup:
    """Return a picture in base64 (SC-H031 if it is too large for a page)."""
    if len(picture) > LARGEST_BYTES:
        what = f"the picture has {len(picture) / 1e6:.1f} MB, too large for a page"
        raise StrandcastError("SC-H031", what, file=file, fix=fix)
    return Markup(base64.b64encode(picture).decode())


def csv_link(rows: Iterable[Iterable[object]], heads: Iterable[str], name: str) -> Markup:
    """Return a link to a table as a CSV file within the page."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([_cell(each) for each in row] for row in (heads, *rows))
    return Markup(
        '<a class="csv" download="{}.csv" href="data:text/csv;charset=utf-8,{}" aria-label="{}">CSV</a>'
    ).format(name, quote(text.getvalue()), f"Table “{name}” as CSV")


def _cell(value: object) -> str:
    """Return a cell as text; one that a spreadsheet would run as a formula is quoted."""
    text = "" if value is None else str(escape(value).striptags()).strip()
    return f"'{text}" if text[:1] in ("=", "@") else text


def page_script(name: str = "viewer.js.jinja") -> str:
    """Return a script that a page's policy lets run."""
    return (Path(__file__).parent / "templates" / name).read_text(encoding="utf-8")
