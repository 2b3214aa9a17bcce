"""YAML and TOML of bounded size and depth: a small file can cost minutes, or memory without end."""

import errno
import os
import reprlib
import tomllib
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.constructor import ConstructorError, RoundTripConstructor, SafeConstructor
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import AliasEvent, CollectionEndEvent, CollectionStartEvent

from strandcast.core.nesting import is_deeper

MOST_BYTES = 1 << 17  # twice what a plane of 1024 markers takes
MOST_EVENTS = 20_000  # likewise; ruamel.yaml reads them in 3 s
MOST_LEVELS = 12  # twice the levels of the deepest setting
TAGS = {f"tag:yaml.org,2002:{name}" for name in ("str", "int", "float", "bool", "null", "seq", "map")}
# In a line: tomllib takes 3 min for one key of 65,000 parts, and 3 s for a file of such keys.
MOST_DOTS = 1000


class BoundError(ValueError):
    """Text that cannot be read: why, and in which line if that is known."""

    def __init__(self, what: str, line: int | None = None) -> None:
        super().__init__(what)
        self.line = line


class _Guarded:
    """A constructor whose errors name the value and its line, whatever exception the library raises."""

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        try:
            value = super().construct_object(node, deep)  # type: ignore[misc]
            if isinstance(value, str):
                value.encode()  # half of a surrogate pair ("\ud800") is not text
            elif isinstance(value, int):
                value.to_bytes(8, signed=True)  # no setting needs more, and long ones cannot be printed
        except YAMLError:
            raise
        except Exception as error:
            what = f"{reprlib.repr(node.value)} is not a valid {str(node.tag).rsplit(':')[-1]}"
            raise ConstructorError(None, None, what, node.start_mark) from error
        return value


class _RoundTrip(_Guarded, RoundTripConstructor):
    """Keeps the lines of keys and values."""


class _Safe(_Guarded, SafeConstructor):
    """Returns plain data."""


def read_bounded(path: Path) -> str:
    """Return a file's text, or raise a `BoundError` if it is too large or not UTF-8."""
    if not path.is_file():  # a pipe would never end
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    with path.open("rb") as file:
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise BoundError(f"is larger than {MOST_BYTES >> 10} KiB, too large for settings")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise BoundError(f"is not UTF-8 text (byte {error.start})") from None


def load_yaml(text: str, lines: bool = False) -> Any:
    """Return the data in YAML text, with the lines of its keys if they are asked for.

    Raises
    ------
    BoundError
        It is not YAML, a value does not fit its type, or it has aliases, too many values or too many levels.
    """
    yaml = YAML(typ="rt") if lines else YAML(typ="safe", pure=True)
    yaml.Constructor = _RoundTrip if lines else _Safe
    try:
        _check_events(text)
        return yaml.load(text)
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else None
        raise BoundError(str(error.problem or "is not valid YAML").splitlines()[0], line) from None
    except YAMLError as error:
        raise BoundError(str(error).splitlines()[0]) from None


def _check_events(text: str) -> None:
    depth = 0
    for count, event in enumerate(YAML(typ="rt").parse(text)):
        line = event.start_mark.line + 1
        if isinstance(event, AliasEvent):
            raise BoundError("uses a YAML alias (*name); write out the value", line)
        if count >= MOST_EVENTS:
            raise BoundError("has too many values for settings", line)
        if getattr(event, "tag", None) and str(event.tag) not in TAGS | {"!"}:
            raise BoundError(f"uses the YAML tag {event.tag}, which settings do not have", line)
        depth += isinstance(event, CollectionStartEvent) - isinstance(event, CollectionEndEvent)
        if depth > MOST_LEVELS:
            raise BoundError(f"has more than {MOST_LEVELS} levels", line)


def load_toml(text: str) -> dict[str, Any]:
    """Return the data in TOML text, or raise a `BoundError` if it is not TOML or too deep."""
    long = [number for number, line in enumerate(text.split("\n"), 1) if line.count(".") > MOST_DOTS]
    if long:
        raise BoundError(f"has more than {MOST_DOTS} dots in a line", long[0])
    deep = BoundError(f"has more than {MOST_LEVELS} levels")
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise deep from None
    except ValueError as error:  # TOMLDecodeError, and integers with thousands of digits
        raise BoundError(f"is not TOML ({error})") from None
    if is_deeper(data, MOST_LEVELS):
        raise deep
    return data
