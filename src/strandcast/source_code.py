"""The content of source files: a hash of the code without comments and descriptions, and the imports.

Parsing all files takes seconds, so the results are kept in the user's cache, by the files' content.
"""

import ast
import hashlib
import json
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from strandcast.user_cache import cached, keep

SOURCES = Path(__file__).resolve().parents[1]
NAME = "source-code-4.json"  # with the number of its format
MOST = 4000  # contents of files that are remembered, some 2 MB (chosen; the package has 300 files)


class SourceCode(NamedTuple):
    """The code of one file: the hash of its syntax tree, and the names that it imports anywhere."""

    sha256: str
    imports: tuple[str, ...]


@cache
def _known() -> dict[str, list[str]]:
    """Return the hash of the code and the imports of each content that was parsed before."""
    try:
        return dict(json.loads(cached(NAME)))
    except (ValueError, TypeError):
        return {}


_added: set[str] = set()  # contents that the user's cache does not hold yet


def code_of(path: Path) -> SourceCode:
    """Return the code of a file, parsed once for each content."""
    text = path.read_bytes()
    key = hashlib.sha256(text).hexdigest()
    if key not in _known():
        code = parse(text)
        _known()[key] = [code.sha256, *code.imports]
        _added.add(key)
    sha256, *imports = _known()[key]
    return SourceCode(sha256, tuple(imports))


def save_codes() -> None:
    """Write the cache if it grew; a cache that cannot be written is no error."""
    kept = list(_known().items())
    kept = kept[-MOST // 2 :] if len(kept) > MOST else kept  # forget what was added first
    if _added and keep(NAME, json.dumps(dict(kept))):
        _added.clear()


@cache
def file_of(module: str) -> Path | None:
    """Return the file of a module of these sources; None if it is none."""
    stem = SOURCES.joinpath(*module.split("."))
    return next((path for path in (stem.with_suffix(".py"), stem / "__init__.py") if path.is_file()), None)


def parse(text: bytes) -> SourceCode:
    """Parse a file: its tree without docstrings and settings' descriptions, and the names that it imports."""
    tree = ast.parse(text)
    imports: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imports.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            imports.add(node.module)
            imports.update(f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Field":
            node.keywords = [each for each in node.keywords if each.arg != "description"]
        body = getattr(node, "body", None)
        if isinstance(body, list) and body and _is_docstring(body[0]):
            body[0] = ast.Pass()
    return SourceCode(hashlib.sha256(_dumped(tree).encode()).hexdigest(), tuple(sorted(imports)))


def _dumped(node: Any) -> str:
    """Return a syntax tree as text, without what it leaves empty: that differs between versions of Python."""
    if isinstance(node, list):
        return f"[{','.join(map(_dumped, node))}]"
    if not isinstance(node, ast.AST):
        return repr(node)
    if isinstance(node, ast.JoinedStr):  # Python 3.12 adds empty parts
        node.values = [part for part in node.values if getattr(part, "value", None) != ""]
    fields = ((name, value) for name, value in ast.iter_fields(node) if value is not None and value != [])
    return f"{type(node).__name__}({','.join(f'{name}={_dumped(value)}' for name, value in fields)})"


def _is_docstring(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
