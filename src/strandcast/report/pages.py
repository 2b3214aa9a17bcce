"""Pages from templates: escaped, strict about names, one file without external resources."""

from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from strandcast.report import numbers


def render(template: str, package: str = "strandcast.report", **values: Any) -> str:
    """Return a page; a name that the template uses but did not get is an error."""
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
    environment.globals["style"] = Markup(environment.get_template("style.css.jinja").render())
    return environment.get_template(template).render(**values)
