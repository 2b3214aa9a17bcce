"""Tables between stages: Parquet with page checksums, schema name, version and units in the metadata."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.files import atomic_write, canonical_json


@dataclass(frozen=True)
class Column:
    """One column: its numpy type ("f8", "i4", "str") and its unit ("m", "s", "rad", "1")."""

    dtype: str
    unit: str


@dataclass(frozen=True)
class TableSpec:
    """What a table holds; `open_ended` tables may carry further float columns (unit in the name)."""

    schema: str
    columns: dict[str, Column]
    version: int = 1
    open_ended: bool = False


ARROW_TYPES = {"f8": pa.float64(), "i4": pa.int32(), "i8": pa.int64(), "str": pa.string()}


def write_table(
    path: str | Path, spec: TableSpec, columns: dict[str, Any], facts: dict[str, Any] | None = None
) -> None:
    """Write columns (each (rows,)) as a table; `facts` are a few plain JSON values kept beside them."""
    names = list(spec.columns) + [name for name in columns if name not in spec.columns]
    missing = [name for name in spec.columns if name not in columns]
    if missing or (len(names) > len(spec.columns) and not spec.open_ended):
        raise ValueError(f"{spec.schema}: missing columns {missing}, given {list(columns)}")
    fields, arrays = [], []
    for name in names:
        column = spec.columns.get(name, Column("f8", ""))
        kind = ARROW_TYPES[column.dtype]
        fields.append(pa.field(name, kind, metadata={"unit": column.unit}))
        values = np.asarray(columns[name])
        arrays.append(pa.array(values.tolist() if column.dtype == "str" else values, type=kind))
    metadata = {"schema": spec.schema, "version": str(spec.version), "facts": canonical_json(facts or {})}
    table = pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=metadata))
    with atomic_write(path) as temporary:
        pq.write_table(table, temporary, compression="zstd", write_page_checksum=True)


def read_table(path: str | Path, spec: TableSpec) -> dict[str, np.ndarray]:
    """Read and verify a table; returns its columns, each (rows,).

    Raises
    ------
    StrandcastError
        The file is missing, damaged, of another schema or version, or lacks a column.
    """
    table = _read(path, spec)
    return {name: _to_numpy(table.column(name)) for name in table.column_names}


def read_facts(path: str | Path, spec: TableSpec) -> dict[str, Any]:
    """Return the plain values kept beside a table."""
    import json

    return dict(json.loads(_read(path, spec).schema.metadata[b"facts"]))


def _to_numpy(column: pa.ChunkedArray) -> np.ndarray:
    if pa.types.is_string(column.type):
        return np.array(column.to_pylist(), dtype=object)
    return np.asarray(column.combine_chunks().to_numpy(zero_copy_only=False))


def _read(path: str | Path, spec: TableSpec) -> pa.Table:
    path = Path(path)
    if not path.is_file():
        raise _refusal("SC-R011", path, None, "the file is not there", "make it first")
    try:
        table = pq.read_table(path, page_checksum_verification=True)
    except (pa.ArrowException, OSError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise _refusal(
            "SC-R011",
            path,
            None,
            f"is damaged or is not a table ({reason})",
            "restore the file, or delete it and make it again",
        ) from None
    metadata = table.schema.metadata or {}
    schema, version = metadata.get(b"schema", b"").decode(), metadata.get(b"version", b"").decode()
    if schema != spec.schema:
        raise _refusal(
            "SC-R012",
            path,
            "schema",
            f"is {schema!r}, wanted {spec.schema!r}",
            "give the file that the stage asks for",
        )
    if version != str(spec.version):
        raise _refusal(
            "SC-R013",
            path,
            "version",
            f"is {version!r}; this strandcast reads {spec.version}",
            "make the file again with this strandcast",
        )
    for name, column in spec.columns.items():
        if name not in table.column_names or table.schema.field(name).type != ARROW_TYPES[column.dtype]:
            raise _refusal(
                "SC-R014",
                path,
                name,
                f"the column is missing or is not of type {column.dtype}",
                "delete the file and make it again",
            )
    return table


def _refusal(code: str, path: Path, field: str | None, what: str, fix: str) -> StrandcastError:
    return StrandcastError(code, what, file=path, field=field, fix=fix, exit_code=INTEGRITY)
