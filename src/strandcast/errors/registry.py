"""The registry of error codes."""

import tomllib
from functools import cache
from pathlib import Path
from typing import NamedTuple

CODES_FILE = Path(__file__).with_name("codes.toml")


class ErrorCode(NamedTuple):
    """One code: its title, its fix in general words, and its cause where it adds something to the title."""

    code: str
    title: str
    fix: str
    cause: str = ""


def read_codes(path: Path = CODES_FILE) -> tuple[dict[str, str], dict[str, ErrorCode]]:
    """Return the subject of each letter, and the codes in the order of the file."""
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    letters: dict[str, str] = data.pop("letters")
    data.pop("merged", None)
    return letters, {code: ErrorCode(code, **words) for code, words in data.items()}


def merged_codes() -> dict[str, str]:
    """Return the codes of former versions, with the present code of each."""
    merged = tomllib.loads(CODES_FILE.read_text(encoding="utf-8"))["merged"]
    return {f"SC-{old}": present for present, olds in merged.items() for old in olds.split()}


@cache
def general_fixes() -> dict[str, str]:
    """Return the fix of each code as it stands in a message."""
    return {code: entry.fix[0].lower() + entry.fix[1:].rstrip(".") for code, entry in read_codes()[1].items()}
