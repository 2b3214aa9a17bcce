"""The cache of this user: texts by name, made again where they are gone or cannot be written."""

import os
from contextlib import suppress
from pathlib import Path


def can_be_written(folder: Path) -> bool:
    """Return whether a folder is there, or can be made, and takes files."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return os.access(folder, os.W_OK)
    except OSError:
        return False


def cache_folder() -> Path | None:
    """Return the folder of this user's caches, or None if it cannot be written; XDG_CACHE_HOME moves it."""
    try:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "strandcast"
    except RuntimeError:  # there is no home
        return None
    return folder if can_be_written(folder) else None


def cached(name: str) -> str:
    """Return the text that is kept under a name; an empty one if none can be read."""
    folder = cache_folder()
    try:
        return "" if folder is None else (folder / name).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return ""


def keep(name: str, text: str) -> bool:
    """Keep a text under a name, as a whole or not at all; return whether that was possible."""
    import tempfile  # slow to import, and most processes only read

    folder = cache_folder()
    if folder is None:
        return False
    try:
        handle, temporary = tempfile.mkstemp(dir=folder)
    except OSError:
        return False
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        Path(temporary).replace(folder / name)
    except OSError:
        with suppress(OSError):
            Path(temporary).unlink()
        return False
    return True
