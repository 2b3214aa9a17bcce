"""Templates to pages: escaped, strict about names, one file, nothing from outside."""

from __future__ import annotations

from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from strandcast.report import numbers


def render(template: str, **values: Any) -> str:
    """Return a page; a name that the template wants and nobody gave is an error."""
    environment = Environment(
        loader=PackageLoader("strandcast.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["mm"] = numbers.millimetres
    environment.filters["ms"] = numbers.milliseconds
    environment.filters["percent"] = numbers.percent
    environment.filters["place"] = numbers.place
    environment.globals["style"] = Markup(environment.get_template("style.css.jinja").render())
    return environment.get_template(template).render(**values)
