"""Tables between stages: Parquet with page checksums; schema, version, units and provenance as metadata."""

import hashlib
import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from strandcast.records.files import canonical_json, write_bytes
from strandcast.records.lineage import Lineage, check_lineage, how_to_make, lineage_at
from strandcast.records.provenance import current_versions
from strandcast.records.record import lineage_in, refusal

MOST_CELLS = 100_000_000  # seven times a track of 60 s at 1 kHz with 30 points
MOST_BYTES = 8 * MOST_CELLS


@dataclass(frozen=True)
class Column:
    """One column: its numpy type ("f8", "i4", "str") and its unit ("m", "s", "rad", "1")."""

    dtype: str
    unit: str


@dataclass(frozen=True)
class TableSpec:
    """The schema of a table: its name, its columns by name, and the version of both."""

    schema: str
    columns: dict[str, Column]
    version: int = 1
    open_ended: bool = False  # it may have further float columns, with their units in their names
    optional: dict[str, Column] = field(default_factory=dict)


ARROW_TYPES = {"f8": pa.float64(), "i4": pa.int32(), "i8": pa.int64(), "str": pa.string()}


def write_table(
    path: str | Path, spec: TableSpec, columns: dict[str, Any], facts: dict[str, Any] | None = None
) -> None:
    """Write columns (each (rows,)) as a table; `facts` are a few plain JSON values stored beside them."""
    further = [name for name in columns if name not in spec.columns]
    missing = [name for name in spec.columns if name not in columns]
    if missing or not (spec.open_ended or spec.optional.keys() >= set(further)):
        raise ValueError(f"{spec.schema}: missing columns {missing}, given {list(columns)}")
    fields, arrays = [], []
    known = spec.columns | spec.optional
    for name in [*spec.columns, *further]:
        column = known.get(name, Column("f8", ""))
        kind = ARROW_TYPES[column.dtype]
        fields.append(pa.field(name, kind, metadata={"unit": column.unit}))
        values = np.asarray(columns[name])
        arrays.append(pa.array(values.tolist() if column.dtype == "str" else values, type=kind))
    metadata = {
        "schema": spec.schema,
        "version": str(spec.version),
        "facts": canonical_json(facts or {}),
        "made_by": canonical_json(current_versions()),
    }
    write_arrow(path, pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=metadata)))


def write_arrow(path: str | Path, table: pa.Table) -> None:
    """Write an Arrow table with the hash of its content, and with the lineage that its place gives it."""
    metadata = dict(table.schema.metadata or {}) | {b"content_sha256": arrow_sha256(table).encode()}
    lineage = lineage_at(path)
    metadata |= {} if lineage is None else {b"lineage": canonical_json(lineage.to_json()).encode()}
    # In memory first: pyarrow prints a traceback when it cannot finish a file on a full disk.
    sink = pa.BufferOutputStream()
    pq.write_table(
        table.replace_schema_metadata(metadata), sink, compression="zstd", write_page_checksum=True
    )
    write_bytes(path, sink.getvalue())


def read_table(path: str | Path, spec: TableSpec) -> dict[str, np.ndarray]:
    """Read, verify and if necessary migrate a table; return its columns, each (rows,).

    Raises
    ------
    StrandcastError
        SC-R001 the file is missing, damaged or changed, or has other columns; SC-R002 another
        schema; SC-R003 a newer version, or one without migration; SC-R006, SC-R007 see `check_lineage`.
    """
    table = read_arrow(path, spec)
    return {name: _to_numpy(table.column(name)) for name in table.column_names}


def read_facts(path: str | Path, spec: TableSpec) -> dict[str, Any]:
    """Return the plain values stored beside a table."""
    return table_facts(read_arrow(path, spec))


def table_facts(table: pa.Table) -> dict[str, Any]:
    """Return the plain values in a table's metadata."""
    return dict(json.loads((table.schema.metadata or {}).get(b"facts", b"{}")))


def table_made_by(table: pa.Table) -> dict[str, str]:
    """Return the versions that made a table; empty for files from before versions were stored."""
    return dict(json.loads((table.schema.metadata or {}).get(b"made_by", b"{}")))


def table_schema(table: pa.Table) -> tuple[str, str]:
    """Return the name and the version of a table's schema; empty where it has none."""
    metadata = table.schema.metadata or {}
    schema, version = (metadata.get(name, b"").decode(errors="replace") for name in (b"schema", b"version"))
    return schema, version


def table_sha256(path: str | Path) -> str:
    """Return the hash of a table's content: schema, version, facts and columns, without `made_by`."""
    return _verified_sha256(Path(path), read_parquet(path))


def arrow_sha256(table: pa.Table) -> str:
    """Return the hash of an Arrow table's content."""
    digest = hashlib.sha256(canonical_json([*table_schema(table), table_facts(table)]).encode())
    for name in table.column_names:
        values = _to_numpy(table.column(name))
        digest.update(f"\0{name}\0{values.dtype}\0".encode())
        digest.update("\0".join(map(str, values)).encode() if values.dtype == object else values.tobytes())
    return digest.hexdigest()


@contextmanager
def fitting(path: str | Path) -> Iterator[None]:
    """Turn the failures of code that takes rows or facts for granted into an error that names their file.

    Raises
    ------
    StrandcastError
        SC-R001 the rows or the facts of a table do not fit together.
    """
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError, MemoryError) as error:
        what = f"its rows or facts do not fit together ({type(error).__name__}: {error})"
        raise refusal("SC-R001", path, None, what) from error


def scattered(shape: tuple[int, ...], at: Any, values: Any, fill: float = np.nan) -> np.ndarray:
    """Return an array of a shape with values at some indices and `fill` elsewhere, of `fill`'s type.

    Raises
    ------
    ValueError, IndexError
        The array would be absurdly large, or an index lies outside of it.
    """
    if math.prod(map(int, shape)) > MOST_CELLS:
        raise ValueError(f"an array of {' x '.join(map(str, shape))} values; at most {MOST_CELLS} are read")
    if any(np.min(index, initial=0) < 0 for index in (at if isinstance(at, tuple) else (at,))):
        raise IndexError("an index below 0")
    array = np.full(shape, fill, dtype=np.int32 if isinstance(fill, int) else float)
    array[at] = values
    return array


def _to_numpy(column: pa.ChunkedArray) -> np.ndarray:
    if pa.types.is_string(column.type):
        return np.array(column.to_pylist(), dtype=object)
    array = column.combine_chunks()
    if not array.null_count and (pa.types.is_integer(array.type) or pa.types.is_floating(array.type)):
        return np.from_dlpack(array)  # to_numpy would load pandas, which takes a second
    return np.asarray(array.to_numpy(zero_copy_only=False))


def read_parquet(path: str | Path) -> pa.Table:
    """Return any Parquet file as an Arrow table, its page checksums verified."""
    path = Path(path)
    if not path.is_file():
        raise refusal("SC-R001", path, None, "the file is not there", how_to_make(path))
    if path.stat().st_size > MOST_BYTES:
        raise refusal("SC-R001", path, None, f"is larger than {MOST_BYTES / 1e6:.0f} MB")
    data = path.read_bytes()  # an error of the disk is not one of the content
    try:
        table = _read_bounded(data)
        canonical_json([table_facts(table), table_made_by(table)]).encode()
        return table
    except (
        pa.ArrowException,
        OSError,
        ValueError,
        TypeError,
        KeyError,
        MemoryError,
        RecursionError,
    ) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        what = f"is damaged or is not a table ({reason})"
        raise refusal("SC-R001", path, None, what) from None


def _read_bounded(data: bytes) -> pa.Table:
    """Read a Parquet file if its footer does not promise too much: a page of zeros takes almost no bytes."""
    with pq.ParquetFile(pa.BufferReader(data), page_checksum_verification=True) as file:
        rows, columns = file.metadata.num_rows, file.metadata.num_columns
        if rows * columns > MOST_CELLS:
            raise ValueError(f"{rows} rows of {columns} columns; at most {MOST_CELLS} values are read")
        names = file.schema_arrow.names
        if len(set(names)) < len(names):
            raise ValueError("two of its columns have one name")
        # Arrow's threads may outlive the call, and one that frees these bytes while Python ends aborts the
        # process (https://github.com/apache/arrow/issues/34314).
        return file.read(use_threads=False)


def read_arrow(path: str | Path, spec: TableSpec) -> pa.Table:
    """Return a table of a known schema as an Arrow table of the present version, verified."""
    path = Path(path)
    table = read_parquet(path)
    schema, version = table_schema(table)
    if schema != spec.schema:
        what = f"is {schema!r}, expected {spec.schema!r}"
        raise refusal("SC-R002", path, "schema", what)
    if version != str(spec.version):
        what = f"is {version!r}; this strandcast reads {spec.version}"
        raise refusal("SC-R003", path, "version", what)
    verify_content(path, table)
    given = {name: column for name, column in spec.optional.items() if name in table.column_names}
    for name, column in (spec.columns | given).items():
        if name not in table.column_names or table.schema.field(name).type != ARROW_TYPES[column.dtype]:
            what = f"the column is missing or is not of type {column.dtype}"
            raise refusal("SC-R001", path, name, what)
        if column.dtype != "f8" and table.column(name).null_count:  # in a column of numbers it is NaN
            what = f"{table.column(name).null_count} of its {len(table)} cells are empty"
            raise refusal("SC-R001", path, name, what)
    unknown = set(table.column_names) - spec.columns.keys() - spec.optional.keys()
    if unknown and not spec.open_ended:
        what = f"unknown columns; {spec.schema} has {', '.join([*spec.columns, *spec.optional])}"
        raise refusal("SC-R001", path, ", ".join(sorted(unknown)), what, "remove these columns")
    return table


def verify_content(path: Path, table: pa.Table) -> Lineage | None:
    """Return the lineage, and check the hash; it covers what page checksums do not: columns and facts."""
    try:
        found = json.loads((table.schema.metadata or {}).get(b"lineage", b"null"))
    except (ValueError, TypeError, RecursionError):
        raise refusal("SC-R001", path, None, "is damaged (its metadata cannot be read)") from None
    _verified_sha256(path, table)
    lineage = lineage_in(path, found)
    check_lineage(path, lineage)
    return lineage


def _verified_sha256(path: Path, table: pa.Table) -> str:
    """Return the hash of a table's content, which must be the one that was written with it, if any was."""
    content, written = arrow_sha256(table), (table.schema.metadata or {}).get(b"content_sha256", b"")
    if written and written != content.encode():
        what = "does not fit the content: the file was changed"
        raise refusal("SC-R001", path, "content_sha256", what)
    return content
