"""Check an RO-Crate that `export crate` wrote, a folder or a zip: every file against its hash.

Nothing is unpacked, and no path in a crate is opened before it is known to lie within the crate.
"""

import hashlib
import os
import re
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path, PurePosixPath
from typing import IO, Any, NamedTuple
from urllib.parse import unquote

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.files import content_sha256
from strandcast.records.record import MOST_BYTES, parse_json
from strandcast.workflow.verify import ORDER, Finding

METADATA = "ro-crate-metadata.json"
OWN_HASH = "#metadata-sha256"
WEB = ("http:", "https:")
SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")
# What zipfile raises for a damaged, encrypted (RuntimeError) or unknown member.
UNREADABLE = (
    OSError,
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    RuntimeError,
    ValueError,
)
RESTORE = "restore it from the archive that holds the crate"


class _Member(NamedTuple):
    """A file in a crate: its size, and how to open it."""

    size_bytes: int
    open: Callable[[], IO[bytes]]


class _Declared(NamedTuple):
    """A file as the metadata describe it."""

    name: str
    size_bytes: str | None
    sha256: str | None
    left_out: bool


def verify_crate(path: Path) -> list[Finding]:
    """Return what is damaged, missing or extra in a crate.

    Raises
    ------
    StrandcastError
        SC-R002 it is no crate that can be read; SC-R052 a path in it leads out of it, or is a link.
    """
    with _opened(path) as members:
        metadata = members.pop(METADATA, None)
        if metadata is None:
            raise _unreadable(path, f"holds no {METADATA} at its top")
        graph = _graph(path, metadata)
        declared = list(_declared(path, graph))
        findings = list(_check_metadata(path, graph))
        findings += [found for each in declared if (found := _check(path, each, members)) is not None]
        known = {each.name for each in declared}
        findings += [
            Finding(path / name, "extra", f"is not named in {METADATA}", "remove it, or make the crate again")
            for name in sorted(members)
            if name not in known
        ]
    return sorted(findings, key=lambda finding: ORDER.index(finding.state))


@contextmanager
def _opened(path: Path) -> Iterator[dict[str, _Member]]:
    if path.is_dir():
        yield dict(_of_folder(path))
        return
    try:
        archive = zipfile.ZipFile(path)
    except UNREADABLE as error:
        raise _unreadable(path, f"is no folder and no readable zip ({error})") from None
    with archive:
        yield _of_zip(path, archive)


def _of_folder(path: Path) -> Iterator[tuple[str, _Member]]:
    for place, folders, names in os.walk(path):
        for name in (*folders, *names):
            file = Path(place, name)
            mode = file.lstat().st_mode
            if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                raise _hostile(path, file.relative_to(path).as_posix(), "is a link or a device")
            if stat.S_ISREG(mode):
                yield (
                    file.relative_to(path).as_posix(),
                    _Member(file.stat().st_size, partial(_open, file)),
                )


def _open(file: Path) -> IO[bytes]:
    return file.open("rb")


def _of_zip(path: Path, archive: zipfile.ZipFile) -> dict[str, _Member]:
    members: dict[str, _Member] = {}
    for entry in archive.infolist():
        name = _within(path, entry.filename)
        if stat.S_ISLNK(entry.external_attr >> 16):
            raise _hostile(path, name, "is a link")
        if name in members:
            raise _hostile(path, name, "is in the zip twice")
        if not entry.is_dir():
            members[name] = _Member(entry.file_size, partial(archive.open, entry))
    return members


def _within(path: Path, name: str) -> str:
    """Return a relative path in normal form, or refuse one that leads out of the crate."""
    parts = PurePosixPath(name).parts
    if not parts or parts[0] == "/" or ".." in parts or "\\" in name or "\0" in name or SCHEME.match(name):
        raise _hostile(path, name, "leads out of the crate")
    return "/".join(parts)


def _graph(path: Path, metadata: _Member) -> dict[str, Any]:
    """Return the metadata, which hold a list of entities."""
    try:
        with metadata.open() as file:
            data = parse_json(file.read(MOST_BYTES + 1))
    except (*UNREADABLE, OverflowError) as error:  # RecursionError is a RuntimeError
        raise _unreadable(path, f"its {METADATA} is not JSON ({error})") from None
    graph: dict[str, Any] = data if isinstance(data, dict) else {}
    entities = graph.get("@graph")
    if not isinstance(entities, list) or not all(
        isinstance(entity, dict) and isinstance(entity.get("@id"), str) for entity in entities
    ):
        raise _unreadable(path, f"its {METADATA} has no @graph of entities, each with an @id")
    return graph


def _declared(path: Path, graph: dict[str, Any]) -> Iterator[_Declared]:
    """Yield the files that the metadata name, in the crate and left out of it."""
    for entity in graph["@graph"]:
        identifier, kinds = entity["@id"], entity.get("@type")
        left_out = identifier.startswith("#")
        is_file = "File" in kinds if isinstance(kinds, list) else kinds == "File"
        if identifier.startswith(WEB) or not (("sha256" in entity) if left_out else is_file):
            continue
        if not left_out and SCHEME.match(identifier):
            raise _hostile(path, identifier, "leads out of the crate")
        size_bytes, sha256 = (
            str(entity[name]) if name in entity else None for name in ("contentSize", "sha256")
        )
        name = unquote(identifier.removeprefix("#") if left_out else identifier)
        yield _Declared(_within(path, name), size_bytes, sha256, left_out)


def _check_metadata(path: Path, graph: dict[str, Any]) -> Iterator[Finding]:
    own = [entity for entity in graph["@graph"] if entity["@id"] == OWN_HASH]
    rest = graph | {"@graph": [entity for entity in graph["@graph"] if entity["@id"] != OWN_HASH]}
    if [entity.get("value") for entity in own] != [content_sha256(rest)]:
        yield Finding(path / METADATA, "damaged", "its content does not match its own hash", RESTORE)


def _check(path: Path, declared: _Declared, members: dict[str, _Member]) -> Finding | None:
    file, member = path / declared.name, members.get(declared.name)
    if member is None:
        what = f"is named in {METADATA}, but is not there"
        return None if declared.left_out else Finding(file, "missing", what, RESTORE)
    if declared.sha256 is None:
        return Finding(file, "damaged", f"cannot be checked: {METADATA} gives no sha256", RESTORE)
    if str(member.size_bytes) != declared.size_bytes:  # before reading: a small zip can unpack to terabytes
        what = f"has {member.size_bytes} bytes, not {declared.size_bytes}"
        return Finding(file, "damaged", what, RESTORE)
    try:
        with member.open() as stream:
            sha256 = hashlib.file_digest(stream, "sha256").hexdigest()  # type: ignore[arg-type]
    except UNREADABLE as error:
        return Finding(file, "damaged", f"cannot be read ({error})", RESTORE)
    if sha256 != declared.sha256:
        return Finding(file, "damaged", "its content does not match its hash", RESTORE)
    return None


def _unreadable(path: Path, what: str) -> StrandcastError:
    fix = "give the folder or the .zip that `strandcast export crate` wrote"
    return StrandcastError("SC-R002", what, file=path, fix=fix, exit_code=INTEGRITY)


def _hostile(path: Path, name: str, what: str) -> StrandcastError:
    return StrandcastError("SC-R052", f"{name!r} {what}", file=path, exit_code=INTEGRITY)
