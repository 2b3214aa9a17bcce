"""Column mappings: the meaning of each column, from a small TOML or YAML file or from options."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from strandcast.config.bounded import BoundError, load_toml, load_yaml, read_bounded
from strandcast.errors import StrandcastError, StrandcastErrors
from strandcast.imports.table import NumberTable

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ANGLE_UNITS = {"rad": 1.0, "deg": 0.017453292519943295}
LARGEST_ANGLE_RAD = 20.0  # three turns: larger angles are degrees
LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}

TimeUnit = Literal["s", "ms", "us", "ns"]
AngleUnit = Literal["rad", "deg"]
LengthUnit = Literal["m", "cm", "mm", "in"]


def unit_named(text: str | None) -> str | None:
    """Return the length unit of a capture file's words, e.g. ``Millimeters``; None if they name none."""
    unit = (text or "").strip().lower().removesuffix("s").replace("metre", "meter")
    unit = {"meter": "m", "centimeter": "cm", "millimeter": "mm", "inch": "in", "inche": "in"}.get(unit, unit)
    return unit if unit in LENGTH_UNITS else None


class Mapping(BaseModel):
    """Base of all mappings: unknown keys are errors, columns may be given by number."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, coerce_numbers_to_str=True)


class JointMapping(Mapping):
    """The columns of a joint log; lists are in the order of the joints from the base."""

    time: str | None = Field(None, description="Column of the controller's time; else `rate_hz` counts.")
    q: list[str] = Field(min_length=1, description="Columns of the measured joint angles.")
    qd: list[str] = Field([], description="… of the measured joint speeds.")
    q_cmd: list[str] = Field([], description="… of the commanded joint angles.")
    qd_cmd: list[str] = Field([], description="… of the commanded joint speeds.")
    time_unit: TimeUnit = "s"
    angle_unit: AngleUnit = "rad"
    rate_hz: float | None = Field(None, gt=0, le=1e6, description="Nominal rate, if known.")
    outputs: str | None = Field(None, description="Column of the digital outputs, one bit each.")


@dataclass(frozen=True)
class JointSource:
    """A joint log's table, the meaning of its columns, the joints' names, and where it comes from."""

    name: str
    table: NumberTable
    columns: JointMapping
    namings: Sequence[list[str]]
    sha256: str
    clock: str
    notes: list[str]


# Options of other names than the fields that they give.
OPTIONS = {"rate_hz": "--rate", "markers": "--marker", "angle_offset_rad": "--angle-offset"}
Kind = TypeVar("Kind", bound=Mapping)


def load_mapping(path: str | Path, kind: type[Kind]) -> Kind:
    """Read a mapping from a TOML or YAML file.

    Raises
    ------
    StrandcastError
        The file is missing or is neither, or with every invalid entry.
    """
    path = Path(path)
    try:
        text = read_bounded(path)
        data = load_toml(text) if path.suffix == ".toml" else load_yaml(text)
    except FileNotFoundError:
        raise StrandcastError("SC-I011", "the mapping is missing", file=path, fix="check the path") from None
    except BoundError as error:
        what = f"is not a mapping ({error})"
        raise StrandcastError("SC-I011", what, file=path, line=error.line, fix="correct the line") from None
    return check_mapping(data, kind, path)


def check_mapping(data: Any, kind: type[Kind], path: Path | None = None) -> Kind:
    """Return a mapping from plain data; every invalid entry is reported at once."""
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        raise StrandcastErrors([_invalid(dict(each), kind, path) for each in error.errors()]) from None


def _invalid(problem: dict[str, Any], kind: type[Mapping], path: Path | None) -> StrandcastError:
    """Return the error for one invalid entry, of a file or of the options."""
    place = [str(part) for part in problem["loc"]]
    is_name = problem["type"] in ("missing", "extra_forbidden")
    given = "" if is_name or isinstance(problem["input"], dict | list) else f", not {problem['input']!r}"
    if path is None:
        option = OPTIONS.get(place[0], f"--{place[0]}".replace("_", "-")) if place else "the options"
        fix = f"give {option} as in strandcast import track --help"
    elif is_name and len(place) == 1:
        fix = f"the keys are {', '.join(kind.model_fields)}"
    else:
        fix = "correct it in this file"
    what = problem["msg"].removeprefix("Value error, ") + given
    return StrandcastError("SC-I011", what, file=path, field=".".join(place) or None, fix=fix)
