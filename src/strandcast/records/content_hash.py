"""The hash by which one result names the results that it was made from."""

from contextlib import suppress
from pathlib import Path

from strandcast.errors import StrandcastError
from strandcast.records.files import content_sha256, sha256_file
from strandcast.records.record import content_of, read_json, verify_hash


def result_sha256(path: str | Path) -> str:
    """Return the hash of a result's content; of the bytes, for a file that is neither record nor table.

    The versions in a file's head or metadata do not count: the same numbers have the same hash, whatever
    patch version of a library made them. A damaged record or table has the hash of its bytes.
    """
    path = Path(path)
    with suppress(StrandcastError):
        if path.suffix == ".json":
            data = read_json(path)
            return content_sha256(verify_hash(path, data) if "content_sha256" in data else content_of(data))
        if path.suffix == ".parquet":
            from strandcast.records.tables import table_sha256

            return table_sha256(path)
    return sha256_file(path)
