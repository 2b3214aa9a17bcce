"""HTML pages as results: written with their lineage and a hash, so that a changed page can be detected."""

import json
from pathlib import Path
from typing import Any

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.files import canonical_json, content_sha256, write_text
from strandcast.records.lineage import Lineage, check_lineage, lineage_at

OPENS, CLOSES = "\n<!-- strandcast ", " -->\n"


def write_page(path: Path, html: str, made_from: str = "") -> None:
    """Write a page atomically; a comment at its end has its lineage, its hash and what it was made from."""
    lineage = lineage_at(path)
    about = {"lineage": None if lineage is None else lineage.to_json(), "sha256": content_sha256(html)}
    if made_from:
        about["made_from"] = made_from
    # "--" must not stand within a comment; in JSON it can only be part of a string.
    text = canonical_json(about).replace("--", "-\\u002d")
    write_text(path, f"{html}{OPENS}{text}{CLOSES}")


def is_made_from(path: Path, made_from: str) -> bool:
    """Return whether a page is there, unchanged, and was made from that."""
    try:
        return path.is_file() and _about(path).get("made_from") == made_from
    except StrandcastError:
        return False


def check_page(path: Path) -> Lineage | None:
    """Verify a page and return its lineage.

    Raises
    ------
    StrandcastError
        SC-R001 it was changed; SC-R006, SC-R007 see `check_lineage`.
    """
    lineage: Lineage | None = _about(path)["lineage"]
    check_lineage(path, lineage)
    return lineage


def _about(path: Path) -> dict[str, Any]:
    """Return what is said of an unchanged page at its end."""
    html, found, end = path.read_bytes().decode(errors="replace").rpartition(OPENS)
    try:
        about = json.loads(end.removesuffix(CLOSES)) if found and end.endswith(CLOSES) else {}
        same = about["sha256"] == content_sha256(html)
        lineage = None if about["lineage"] is None else Lineage.from_json(about["lineage"])
    except (ValueError, KeyError, TypeError, RecursionError):
        same = False
    if not same:
        raise StrandcastError("SC-R001", "was changed since it was made", file=path, exit_code=INTEGRITY)
    return about | {"lineage": lineage}
