"""Column mappings: the meaning of each column, from a small TOML or YAML file or from options."""

from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from strandcast.config.bounded import BoundError, load_toml, load_yaml, read_bounded
from strandcast.errors import StrandcastError, StrandcastErrors

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ANGLE_UNITS = {"rad": 1.0, "deg": 0.017453292519943295}
LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}

TimeUnit = Literal["s", "ms", "us", "ns"]
AngleUnit = Literal["rad", "deg"]
LengthUnit = Literal["m", "cm", "mm"]


def unit_named(text: str | None) -> str | None:
    """Return the length unit of a capture file's words, e.g. ``Millimeters``; None if they name none."""
    unit = (text or "").strip().lower()
    unit = {"meters": "m", "centimeters": "cm", "millimeters": "mm"}.get(unit, unit)
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


class CaptureMarker(Mapping):
    """A marker on the string: its place along the free string, and the columns of its position."""

    place_m: float = Field(ge=0, le=20, description="Distance from the clamp along the string.")
    x: str
    y: str
    point: int | None = Field(None, ge=1, description="Mass point; by default the nearest to the place.")


class CaptureUnits(Mapping):
    """Time and units of a capture; what is not given is the file's own."""

    time: str | None = Field(None, description="Column of the time; not needed where the file has a rate.")
    time_unit: TimeUnit = "s"
    rate_hz: float | None = Field(None, gt=0, le=1e6, description="Rows per second, where no column is.")
    length_unit: LengthUnit | None = None
    sigma_m: float = Field(1e-3, gt=0, le=0.1, description="Standard error of a marker's coordinate.")

    def unit_m(self) -> float:
        """Return the unit of lengths [m]; see `capture_table.with_units`."""
        return LENGTH_UNITS[self.length_unit or "m"]


class CaptureMapping(CaptureUnits):
    """The columns of a motion capture: the hand's pose and the markers on the string, in the motion plane."""

    hand_x: str
    hand_y: str
    hand_angle: str | None = Field(
        None, description="If not given, the angle is constant: `angle_offset_rad`."
    )
    angle_sign: Literal[-1, 1] = Field(1, description="-1 where the file's angle grows clockwise.")
    angle_offset_rad: float = Field(
        0.0, description="Direction in which the string leaves the hand when the file's angle is zero."
    )
    markers: list[CaptureMarker] = Field(min_length=1)
    angle_unit: AngleUnit = "rad"
    motion_start_s: float | None = Field(None, description="By default the first and the last row.")
    motion_end_s: float | None = None


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
    return check_mapping(mapping_data(path), kind, Path(path))


def mapping_data(path: str | Path) -> Any:
    """Return the plain data of a TOML or YAML file; see `load_mapping` for the errors."""
    path = Path(path)
    try:
        text = read_bounded(path)
        return load_toml(text) if path.suffix == ".toml" else load_yaml(text)
    except FileNotFoundError:
        raise StrandcastError("SC-I010", "the mapping is missing", file=path, fix="check the path") from None
    except BoundError as error:
        what = f"is not a mapping ({error})"
        raise StrandcastError("SC-I010", what, file=path, line=error.line, fix="correct the line") from None


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


def capture_mapping_of(time: str | None, hand: str, markers: list[str], **more: Any) -> CaptureMapping:
    """Return a mapping from command-line arguments.

    Parameters
    ----------
    time
        Column of the time, if it has to be named.
    hand
        Columns ``X,Y`` or ``X,Y,ANGLE``.
    markers
        One ``PLACE:X,Y`` each: the place along the string [m] and two columns, e.g. ``0.2:x_mid,z_mid``;
        ``PLACE@POINT:X,Y`` names the mass point too.
    more
        Further fields of `CaptureMapping`.
    """
    columns = [word.strip() for word in hand.split(",")]
    if len(columns) not in (2, 3):
        raise StrandcastError(
            "SC-I012", f"{hand!r} is not X,Y or X,Y,ANGLE", field="hand", fix="name two or three columns"
        )
    data = {
        "time": time,
        "hand_x": columns[0],
        "hand_y": columns[1],
        "markers": [_marker_argument(m) for m in markers],
    }
    if len(columns) == 3:
        data["hand_angle"] = columns[2]
    return check_mapping(data | more, CaptureMapping)


def _marker_argument(words: str) -> dict[str, Any]:
    place, colon, columns = words.partition(":")
    place, _, point = place.partition("@")
    names = [name.strip() for name in columns.split(",")]
    if not colon or len(names) != 2:
        raise StrandcastError(
            "SC-I012", f"{words!r} is not PLACE:X,Y", field="marker", fix="e.g. 0.2:x_mid,z_mid"
        )
    return {"place_m": place, "x": names[0], "y": names[1]} | ({"point": point} if point else {})
