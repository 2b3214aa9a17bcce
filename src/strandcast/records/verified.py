"""Any result file, verified: what it was made from, and by which versions."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from strandcast.records.lineage import Lineage, place_of
from strandcast.records.load import RECORDS, TABLES
from strandcast.records.page import check_page
from strandcast.records.record import read_json, verify_hash
from strandcast.records.tables import read_arrow, read_parquet, table_made_by, table_schema, verify_content

# That stages and commands write among the raw files of a trial or a rehearsal.
RAW_RECORDS = ("motion.json", "run.json", "track.json", "alignment.json")


class Verified(NamedTuple):
    """A file that is as it was made: its lineage and the versions that made it."""

    lineage: Lineage | None
    made_by: dict[str, str]


def _verify_record(path: Path) -> Verified:
    place = place_of(path)
    is_raw = path.parent.name == "rehearsal" if place is None else place.raw
    if is_raw and path.name not in RAW_RECORDS:
        return Verified(None, {})  # a file of the user's own
    data = read_json(path)
    kind = RECORDS.get(str(data.get("schema")))
    if kind is None:
        verify_hash(path, data)
        return Verified(None, {})
    record = kind.read(path)
    return Verified(record.lineage, record.made_by)


def _verify_table(path: Path) -> Verified:
    table = read_parquet(path)
    lineage = verify_content(path, table)
    spec = TABLES.get(table_schema(table)[0])
    if spec is not None:
        read_arrow(path, spec)
    return Verified(lineage, table_made_by(table))


# Each raises a `StrandcastError` for a file that was damaged or misplaced, or made from other inputs.
READERS: dict[str, Callable[[Path], Verified]] = {
    ".json": _verify_record,
    ".parquet": _verify_table,
    ".html": lambda path: Verified(check_page(path), {}),
}
