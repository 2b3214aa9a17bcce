"""The registry of error codes, and docs/errors.md made from it."""

import tomllib
from functools import cache
from pathlib import Path
from typing import NamedTuple

CODES_FILE = Path(__file__).with_name("codes.toml")
HEAD = """\
# Error codes

Every problem that strandcast reports has a code, which stands for what to do about it. The message says what
is wrong in this case: the file, the line or field, the offending value and what ignoring it would cost. Its
fix is the one below, or a more exact one. `strandcast explain CODE` prints an entry, also for a code of a
former version.

<!-- Generated from src/strandcast/errors/codes.toml by `python -m strandcast.errors > docs/errors.md`. -->
"""


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


def errors_page(path: Path = CODES_FILE) -> str:
    """Return docs/errors.md: one section per letter, one entry per code."""
    letters, codes = read_codes(path)
    parts = [HEAD]
    for letter, subject in letters.items():
        parts.append(f"\n## SC-{letter}: {subject}\n")
        for code in sorted(code for code in codes if code[3] == letter):
            entry = codes[code]
            cause = f"{entry.cause}\n\n" if entry.cause else ""
            parts.append(f"\n### {code}: {entry.title}\n\n{cause}**Fix:** {entry.fix}\n")
    return "".join(parts)
