"""HTML pages as results: written with their lineage and a hash, so that a changed page can be detected."""

import json
from pathlib import Path

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.files import canonical_json, content_sha256, write_text
from strandcast.records.lineage import Lineage, check_lineage, lineage_at

OPENS, CLOSES = "\n<!-- strandcast ", " -->\n"


def write_page(path: Path, html: str) -> None:
    """Write a page atomically, with its lineage and its hash in a comment at its end."""
    lineage = lineage_at(path)
    about = {"lineage": None if lineage is None else lineage.to_json(), "sha256": content_sha256(html)}
    # "--" must not stand within a comment; in JSON it can only be part of a string.
    text = canonical_json(about).replace("--", "-\\u002d")
    write_text(path, f"{html}{OPENS}{text}{CLOSES}")


def check_page(path: Path) -> Lineage | None:
    """Verify a page and return its lineage.

    Raises
    ------
    StrandcastError
        SC-R001 it was changed; SC-R006, SC-R007 see `check_lineage`.
    """
    html, found, end = path.read_bytes().decode(errors="replace").rpartition(OPENS)
    try:
        about = json.loads(end.removesuffix(CLOSES)) if found and end.endswith(CLOSES) else {}
        same = about["sha256"] == content_sha256(html)
        lineage = None if about["lineage"] is None else Lineage.from_json(about["lineage"])
    except (ValueError, KeyError, TypeError, RecursionError):
        same = False
    if not same:
        raise StrandcastError("SC-R001", "was changed since it was made", file=path, exit_code=INTEGRITY)
    check_lineage(path, lineage)
    return lineage
