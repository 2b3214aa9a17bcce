"""What all small JSON records share: schema name, version, content hash, atomic write, verified read."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, ValidationError

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.files import content_sha256, write_text

HEAD = ("schema", "version", "content_sha256")


class Part(BaseModel):
    """A named group of fields within a record; numbers must be finite."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=False, ser_json_inf_nan="constants")


class Record(Part):
    """A small JSON file between stages.

    On disk it opens with ``schema``, ``version`` and ``content_sha256`` (the hash of the canonical form of
    everything else), so that damage and foreign files are told from each other and from old versions.
    Unknown keys are kept; an unknown version is refused.
    """

    SCHEMA: ClassVar[str]
    VERSION: ClassVar[int] = 1

    def content(self) -> dict[str, Any]:
        """Return the record as plain JSON data, without the head."""
        return self.model_dump(mode="json")

    def content_sha256(self) -> str:
        """Return the hash that names this record's content."""
        return content_sha256(self.content())

    def write(self, path: str | Path) -> None:
        """Write the record atomically."""
        content = self.content()
        head = {"schema": self.SCHEMA, "version": self.VERSION, "content_sha256": content_sha256(content)}
        write_text(path, json.dumps(head | content, indent=1, allow_nan=False, ensure_ascii=False) + "\n")

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read and verify a record.

        Raises
        ------
        StrandcastError
            The file is missing, is not JSON, is of another schema or version, was changed, or does not fit.
        """
        data = _load(path)
        if data.get("schema") != cls.SCHEMA:
            raise _refusal(
                "SC-R002",
                path,
                "schema",
                f"is {data.get('schema')!r}, wanted {cls.SCHEMA!r}",
                "give the file that the stage asks for",
            )
        if data.get("version") != cls.VERSION:
            raise _refusal(
                "SC-R003",
                path,
                "version",
                f"is {data.get('version')!r}; this strandcast reads version {cls.VERSION}",
                "make the file again with this strandcast, or use the one that wrote it",
            )
        content = {key: value for key, value in data.items() if key not in HEAD}
        if content_sha256(content) != data.get("content_sha256"):
            raise _refusal(
                "SC-R004",
                path,
                "content_sha256",
                "does not fit the content: the file was changed",
                "restore the file, or delete it and make it again",
            )
        try:
            return cls.model_validate(content)
        except ValidationError as error:
            first = error.errors()[0]
            raise _refusal(
                "SC-R005",
                path,
                ".".join(str(part) for part in first["loc"]),
                first["msg"],
                "delete the file and make it again",
            ) from None


def _load(path: str | Path) -> dict[str, Any]:
    path = Path(path)
    try:
        data = json.loads(path.read_bytes(), parse_constant=_refuse_constant, parse_float=_finite)
    except FileNotFoundError:
        raise _refusal("SC-R001", path, None, "the file is not there", "make it first") from None
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise _refusal(
            "SC-R001",
            path,
            None,
            f"is not a JSON record ({error})",
            "restore the file, or delete it and make it again",
        ) from None
    if not isinstance(data, dict):
        raise _refusal(
            "SC-R001",
            path,
            None,
            "is not a JSON record (no object at its top)",
            "restore the file, or delete it and make it again",
        )
    return data


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not JSON")


def _finite(text: str) -> float:
    value = float(text)
    if math.isinf(value):  # 1e999 is JSON, but no number that a record holds
        raise ValueError(f"{text} is too large a number")
    return value


def _refusal(code: str, path: str | Path, field: str | None, what: str, fix: str) -> StrandcastError:
    return StrandcastError(code, what, file=path, field=field, fix=fix, exit_code=INTEGRITY)
