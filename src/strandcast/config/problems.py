"""Validation errors as messages with line, field and fix."""

import difflib
import reprlib
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel
from pydantic_core import ErrorDetails
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from strandcast.config.experiment import Conflict, Experiment
from strandcast.config.schema import SCHEMA_FILE, models_in
from strandcast.core.objectives import OBJECTIVES
from strandcast.errors import StrandcastError

SHOWN = reprlib.Repr()  # of an offending value
SHOWN.maxstring = SHOWN.maxother = 80


def one_per_place(data: Any, details: list[ErrorDetails]) -> list[tuple[tuple[str, ...], ErrorDetails]]:
    """Return one error per position in the file; of a union's branches, the one that lists the choices."""
    kept: dict[tuple[str, ...], ErrorDetails] = {}
    for detail in details:
        place = _place(data, detail)
        if place not in kept or detail["type"] == "literal_error":
            kept[place] = detail
    # A union reports the whole value and its parts; the parts are more precise.
    wholes = {place[:k] for place in kept for k in range(len(place))}
    return [(place, detail) for place, detail in kept.items() if place not in wholes]


def _conflict(detail: ErrorDetails) -> Conflict | None:
    error = detail.get("ctx", {}).get("error")
    return error if isinstance(error, Conflict) else None


def _place(node: Any, detail: ErrorDetails) -> tuple[str, ...]:
    """Return the position of an error in the file: pydantic's location without union branches."""
    place = []
    conflict = _conflict(detail)
    fields = () if conflict is None else tuple(conflict.field.split("."))
    absent = detail["loc"][-1:] if detail["type"] == "missing" else fields
    for part in _as_written(node, (*detail["loc"], *fields)):
        child = _child(node, part)
        if child is not None:
            node = child
        elif part not in absent:
            continue
        place.append(str(part))
    return tuple(place)


def _as_written(data: Any, loc: tuple[int | str, ...]) -> tuple[int | str, ...]:
    """Return a location in a file that writes `camera: …` for `cameras: {main: …}`."""
    if loc[:1] == ("cameras",) and isinstance(data, CommentedMap) and "camera" in data:
        return ("camera", *loc[2:])
    return loc


def _child(node: Any, part: int | str) -> Any:
    """Return the child of a YAML node at a key or index, or None."""
    if isinstance(node, CommentedMap):
        return node.get(part)
    if isinstance(node, CommentedSeq) and str(part).isdigit() and int(part) < len(node):
        return node[int(part)]
    return None


def problem(path: Path, data: CommentedMap, place: tuple[str, ...], detail: ErrorDetails) -> StrandcastError:
    """Return a validation error as a message with line, field and fix."""
    value = detail["input"]
    what = detail["msg"].removeprefix("Value error, ")
    what = what[0].lower() + what[1:]
    if detail["type"] == "extra_forbidden":
        what = "there is no such setting"
    elif detail["type"] == "union_tag_not_found":
        what = "has no kind"
    elif detail["type"] != "missing" and not isinstance(value, dict | list):
        what += f" (got {SHOWN.repr(value)})"
    return StrandcastError(
        "SC-F003",
        what,
        file=path,
        line=line_of(data, place),
        field=".".join(place) or None,
        fix=_suggestion(detail, place),
    )


def line_of(node: Any, place: tuple[str, ...]) -> int:
    """Return the line of the deepest part of `place` that the file has."""
    line = 1
    for part in place:
        child = _child(node, part)
        if child is None:
            break
        where = node.lc.key(part) if isinstance(node, CommentedMap) else node.lc.item(int(part))
        line, node = where[0] + 1, child
    return line


def _suggestion(detail: ErrorDetails, place: tuple[str, ...]) -> str:
    kind, value, name = detail["type"], detail["input"], place[-1] if place else ""
    conflict = _conflict(detail)
    if conflict is not None:
        return conflict.fix
    if kind == "extra_forbidden":
        allowed = _fields_beside(detail["loc"])
        near = difflib.get_close_matches(name, allowed, n=1, cutoff=0.5)
        return f"did you mean {near[0]!r}?" if near else f"one of: {', '.join(allowed)}"
    if kind == "missing":
        return "add it"
    if kind.startswith("less_than"):
        return _unit_hint(place, value)
    if kind.startswith("union_tag"):
        near = difflib.get_close_matches(str(value.get("kind")), OBJECTIVES, n=1)
        meant = f"did you mean {near[0]!r}? " if near else ""
        return f"{meant}kind is one of {', '.join(sorted(OBJECTIVES))}, or of a package to install"
    if kind == "literal_error":
        choices = str(detail.get("ctx", {}).get("expected", ""))
        names = [choice.strip("' ") for choice in choices.replace(" or ", ",").split(",")]
        near = difflib.get_close_matches(str(value), names, n=1)
        return f"did you mean {near[0]!r}?" if near else f"one of {choices}"
    if isinstance(value, str) and kind in {"float_type", "int_type"}:
        return "write a number, without quotes"
    return f"see {SCHEMA_FILE} for what is allowed"


def _unit_hint(place: tuple[str, ...], value: Any) -> str:
    named = [part for part in place if not part.isdigit()]
    if named and named[-1].endswith("_m"):
        return f"lengths are in metres: {value:g} mm would be {value / 1000:g}"
    if named and named[-1].endswith("_s"):
        return f"times are in seconds: {value:g} ms would be {value / 1000:g}"
    return f"see {SCHEMA_FILE} for what is allowed"


def _fields_beside(loc: tuple[int | str, ...]) -> list[str]:
    """Return the names that are allowed beside an unknown one."""
    annotation: Any = Experiment
    for part in loc[:-1]:
        models = models_in(annotation)
        of_kind = [model for model in models if part in _kinds(model)]
        if of_kind:
            annotation = of_kind[0]
        elif models and part in models[0].model_fields:
            annotation = models[0].model_fields[str(part)].annotation
    return [name for model in models_in(annotation)[:1] for name in model.model_fields]


def _kinds(model: type[BaseModel]) -> tuple[Any, ...]:
    field = model.model_fields.get("kind")
    return () if field is None else get_args(field.annotation)
