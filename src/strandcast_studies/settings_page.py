"""docs/reference/settings.md, from the settings: `python -m strandcast_studies.settings_page`."""

import json
import types
from collections.abc import Iterator
from inspect import cleandoc
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import to_jsonable_python

from strandcast.config.experiment import Experiment
from strandcast.config.schema import models_in

HEAD = """# Settings of experiment.yaml

<!-- made by: python -m strandcast_studies.settings_page > docs/reference/settings.md -->

Each setting with its default, the values that it takes where the default does not show them (x is a number,
n a whole number), and what it means; a name ends in its unit. `strandcast check EXPERIMENT` reports every
invalid setting with its line and its bounds; editors complete and check the file by `strandcast docs schema`.
"""
SCALARS = {float: "x", int: "n", str: "text", bool: "`true`, `false`"}
Rows = list[tuple[str, FieldInfo]]


def settings_page() -> str:
    """Return the page of all settings: a list for each group."""
    return HEAD + "".join(_group(*group) for group in groups(Experiment, "", ""))


def fields(model: type[BaseModel] = Experiment, path: str = "") -> Iterator[tuple[str, FieldInfo]]:
    """Yield the path and declaration of each setting, sections included."""
    for name, field in model.model_fields.items():
        yield f"{path}{name}", field
        for section in models_in(field.annotation):
            yield from fields(section, f"{path}{name}.")


def groups(model: type[BaseModel], path: str, what: str) -> Iterator[tuple[str, str, Rows]]:
    """Yield each group of settings: its path, what it is, and its own settings that are no groups."""
    own = [(name, field) for name, field in model.model_fields.items() if name in model.__annotations__]
    rows = [(name, field) for name, field in own if not is_group(field)]
    yield path, what, rows
    for name, field in own:
        for section in models_in(field.annotation):
            kinds = get_args(section.model_fields["kind"].annotation) if name == "objective" else ()
            what = cleandoc(section.__doc__ or "").split("\n")[0] if kinds else field.description or ""
            step = f"{_step(name, field)}{f' ({kinds[0]})' if kinds else ''}"
            yield from groups(section, f"{path}{step}.", what)


def is_group(field: FieldInfo) -> bool:
    """Return whether a setting only holds other settings."""
    return bool(models_in(field.annotation)) and not _values(field.annotation)


def _step(name: str, field: FieldInfo) -> str:
    origin = get_origin(field.annotation)
    return name + ("[]" if origin is list else ".NAME" if origin is dict else "")


def _group(path: str, what: str, rows: Rows) -> str:
    lines = ["", f"## {path.rstrip('.') or 'The experiment'}", "", *([what, ""] if what else [])]
    return "\n".join([*lines, *(_line(name, field) for name, field in rows)]) + "\n"


def _line(name: str, field: FieldInfo) -> str:
    values = allowed(field)
    return f"- `{name}`{_default(field)}{values and f' ({values})'}: {field.description}"


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return ", **required**"
    value = field.get_default(call_default_factory=True)
    if value in (None, "", []):
        return ""
    return f" = `{value if isinstance(value, str) else json.dumps(to_jsonable_python(value))}`"


def allowed(field: FieldInfo) -> str:
    """Return the values that a setting takes, in words; '' for any number, text or truth value."""
    values = " or ".join(_values(field.annotation))
    return "" if values in SCALARS.values() else values


def _values(annotation: Any) -> list[str]:
    """Return the kinds of values of an annotation; none for groups of settings."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _values(parts[0])
    if origin in (Union, types.UnionType):
        return [value for part in parts if part is not type(None) for value in _values(part)]
    if origin is Literal:
        return [", ".join(f"`{json.dumps(value).strip(chr(34))}`" for value in parts)]
    if origin is list or (origin is tuple and parts[-1] is ...):
        inner = _values(parts[0])
        return [f"list of {' or '.join(inner)}"] if inner else []
    if origin is tuple:
        return [f"[{', '.join(' or '.join(_values(part)) for part in parts)}]"]
    if origin is dict:
        inner = _values(parts[1])
        return [f"by name: {' or '.join(inner)}"] if inner else []
    return [] if issubclass(annotation, BaseModel) else [SCALARS[annotation]]


if __name__ == "__main__":
    print(settings_page(), end="")
