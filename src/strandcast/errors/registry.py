"""The registry of error codes, and docs/errors.md made from it."""

import tomllib
from pathlib import Path
from typing import NamedTuple

CODES_FILE = Path(__file__).with_name("codes.toml")
HEAD = """\
# Error codes

Every problem that strandcast reports has a code. The message adds the file, the line or field, the offending
value, what ignoring it would cost, and a fix for that case; this page says in general what each code means.

<!-- Generated from src/strandcast/errors/codes.toml by `python -m strandcast.errors > docs/errors.md`. -->
"""


class ErrorCode(NamedTuple):
    """One code: its title, its cause and its fix in general words."""

    code: str
    title: str
    cause: str
    fix: str


def read_codes(path: Path = CODES_FILE) -> tuple[dict[str, str], dict[str, ErrorCode]]:
    """Return the subject of each letter, and the codes in the order of the file."""
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    letters: dict[str, str] = data.pop("letters")
    return letters, {code: ErrorCode(code, **words) for code, words in data.items()}


def errors_page(path: Path = CODES_FILE) -> str:
    """Return docs/errors.md: one section per letter, one entry per code."""
    letters, codes = read_codes(path)
    parts = [HEAD]
    for letter, subject in letters.items():
        parts.append(f"\n## SC-{letter}: {subject}\n")
        for code in sorted(code for code in codes if code[3] == letter):
            entry = codes[code]
            parts.append(f"\n### {code}: {entry.title}\n\n{entry.cause}\n\n**Fix:** {entry.fix}\n")
    return "".join(parts)
