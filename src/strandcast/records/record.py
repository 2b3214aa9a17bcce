"""The base of all JSON records: schema, version, content hash, migration, atomic write, verified read."""

import json
import logging
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, PrivateAttr, ValidationError

from strandcast.core.nesting import is_deeper
from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.files import canonical_json, content_sha256, write_text
from strandcast.records.lineage import Lineage, check_lineage, how_to_make, lineage_at
from strandcast.records.provenance import current_versions

log = logging.getLogger(__name__)

MOST_BYTES = 64 << 20  # a motion of 60 s at 1 kHz of seven joints takes about 35 MiB
MOST_LEVELS = 32  # chosen; records have eight at most
HEAD = ("schema", "version", "content_sha256", "made_by", "lineage")

Migration = Callable[[dict[str, Any]], dict[str, Any]]


class Part(BaseModel):
    """A named group of fields within a record; numbers must be finite."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=False, ser_json_inf_nan="constants")


ARM_FILE = "the arm's file"  # `field` of faults in it


class RigFault(Part):
    """A fault of the rig, or a wrong number in its files: what it is, what it costs, and what to do.

    `field` is what to correct, in a few words.
    """

    what: str
    cost: str
    fix: str
    field: str

    @property
    def words(self) -> str:
        """The fault as a warning."""
        return f"{self.what}: {self.fix}"


class Record(Part):
    """A small JSON file between stages.

    On disk it opens with a head: ``schema``, ``version``, ``content_sha256`` (the hash of the canonical form
    of all other fields), ``made_by`` (versions) and ``lineage`` (experiment, trial, stage, hashes of inputs).
    The same content has the same hash whatever it was made by and from. ``lineage`` has a hash of its own; a
    changed byte within ``made_by`` is not detected. Unknown keys are kept. An older version is migrated; a
    newer one is refused.
    """

    SCHEMA: ClassVar[str]
    VERSION: ClassVar[int] = 1
    REUSABLE: ClassVar[bool] = False  # whether a raw file of this kind may be used for another trial
    # Version -> function that turns that version's content into the content of the next version.
    MIGRATIONS: ClassVar[Mapping[int, Migration]] = {}

    _made_by: dict[str, str] = PrivateAttr(default_factory=current_versions)

    _lineage: Lineage | None = PrivateAttr(default=None)

    @property
    def lineage(self) -> Lineage | None:
        """Return what a record that was read belongs to and was made from; None where it does not say."""
        return self._lineage

    @property
    def made_by(self) -> dict[str, str]:
        """Return the versions that made the record; empty for files from before versions were stored."""
        return self._made_by

    def __eq__(self, other: object) -> bool:
        """Compare the content; the versions that made it do not count."""
        return type(self) is type(other) and isinstance(other, Record) and self.content() == other.content()

    def content(self) -> dict[str, Any]:
        """Return the record as plain JSON data, without the head."""
        return self.model_dump(mode="json")

    def content_sha256(self) -> str:
        """Return the hash that identifies this record's content."""
        return content_sha256(self.content())

    def write(self, path: str | Path) -> None:
        """Write the record atomically."""
        content = self.content()
        head = {
            "schema": self.SCHEMA,
            "version": self.VERSION,
            "content_sha256": content_sha256(content),
            "made_by": self.made_by,
        }
        lineage = lineage_at(path)
        head |= {} if lineage is None else {"lineage": lineage.to_json()}
        write_text(path, json.dumps(head | content, indent=1, allow_nan=False, ensure_ascii=False) + "\n")

    @classmethod
    def read(cls, path: str | Path, *, inputs: bool = True) -> Self:
        """Read, verify and if necessary migrate a record; with `inputs`, check too that these are the same.

        Raises
        ------
        StrandcastError
            SC-R001 the file is missing, not JSON, or changed, or its fields do not fit; SC-R002 another
            schema; SC-R003 a newer version, or one without migration; SC-R006, SC-R007 see `check_lineage`.
        """
        data = read_json(path)
        if data.get("schema") != cls.SCHEMA:
            what = f"is {data.get('schema')!r}, expected {cls.SCHEMA!r}"
            raise refusal("SC-R002", path, "schema", what)
        version = data.get("version")
        steps = range(version, cls.VERSION) if type(version) is int and version <= cls.VERSION else None
        if steps is None or not all(old in cls.MIGRATIONS for old in steps):
            what = f"is {version!r}; this strandcast reads version {cls.VERSION}"
            raise refusal("SC-R003", path, "version", what)
        content = verify_hash(path, data)
        lineage = lineage_in(path, data.get("lineage"))
        check_lineage(path, lineage, reusable=cls.REUSABLE, inputs=inputs)
        for old in steps:
            log.info("%s: migrated from version %s of %s", path, old, cls.SCHEMA)
            try:
                content = cls.MIGRATIONS[old](content)
            except (LookupError, TypeError, ValueError, AttributeError) as error:
                what = f"version {old} cannot be migrated ({type(error).__name__}: {error})"
                raise refusal("SC-R001", path, "version", what) from None
        try:
            record = cls.model_validate(content)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(str(part) for part in first["loc"])
            raise refusal("SC-R001", path, place, first["msg"]) from None
        record._lineage, record._made_by = lineage, data.get("made_by", {})
        made_by = record._made_by
        if not isinstance(made_by, dict) or not all(isinstance(value, str) for value in made_by.values()):
            raise refusal("SC-R001", path, "made_by", "must be versions by name")
        return record


def verify_hash(path: str | Path, data: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record's JSON data without the head, or raise SC-R001 if the hash in the head is another."""
    content = content_of(data)
    if content_sha256(content) != data.get("content_sha256"):
        what = "does not fit the content: the file was changed"
        raise refusal("SC-R001", path, "content_sha256", what)
    return content


def lineage_in(path: str | Path, data: Any) -> Lineage | None:
    """Return the lineage in a file's head; None for files from before lineage was stored."""
    try:
        return None if data is None else Lineage.from_json(data)
    except ValueError as error:
        raise refusal("SC-R001", path, "lineage", str(error)) from None


def content_of(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record's JSON data without the head."""
    return {key: value for key, value in data.items() if key not in HEAD}


def read_json(path: str | Path) -> dict[str, Any]:
    """Return the JSON object in a file, refusing NaN, infinity and anything but one object."""
    path = Path(path)
    if not path.is_file():  # reading a pipe would never end
        raise refusal("SC-R001", path, None, "the file is not there", how_to_make(path))
    try:
        with path.open("rb") as file:
            data = parse_json(file.read(MOST_BYTES + 1))
    except (ValueError, OverflowError, RecursionError) as error:
        raise refusal("SC-R001", path, None, f"is not a JSON record ({error})") from None
    if not isinstance(data, dict):
        raise refusal("SC-R001", path, None, "is not a JSON record (no object at its top)")
    return data


def parse_json(content: bytes) -> Any:
    """Return the data in JSON text, or raise a `ValueError`, `OverflowError` or `RecursionError`.

    NaN, infinity, integers of more than 64 bits and more than `MOST_BYTES` or `MOST_LEVELS` are refused.
    """
    if len(content) > MOST_BYTES:
        raise ValueError(f"larger than {MOST_BYTES >> 20} MiB")
    data = json.loads(content, parse_constant=_refuse_constant, parse_float=_finite, parse_int=_int64)
    if is_deeper(data, MOST_LEVELS):
        raise ValueError(f"more than {MOST_LEVELS} levels")
    if b"\\u" in content:
        canonical_json(data).encode()  # half of a surrogate pair ("\\ud800") is not text
    return data


def finite(value: float | None) -> float | None:
    """Return a number as a record stores it: None for one that is not finite."""
    return None if value is None or not math.isfinite(value) else float(value)


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not JSON")


def _finite(text: str) -> float:
    value = float(text)
    if math.isinf(value):  # 1e999 is valid JSON, but not a number that a record may hold
        raise ValueError(f"{text} is too large a number")
    return value


def _int64(text: str) -> int:
    value = int(text)
    value.to_bytes(8, signed=True)  # OverflowError: no count or time needs more, and no array holds it
    return value


def refusal(
    code: str, path: str | Path, field: str | None, what: str, fix: str | None = None, line: int | None = None
) -> StrandcastError:
    """Return the error for a file that cannot be used."""
    return StrandcastError(code, what, file=path, line=line, field=field, fix=fix, exit_code=INTEGRITY)
