"""The door for video files: regular files that a video reader knows, and nothing else."""

from __future__ import annotations

import difflib
import hashlib
import re
from pathlib import Path

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.files import sha256_file

IMAGES = (".png", ".tif", ".tiff")
PHOTRON = (".cihx", ".cih", ".mraw")


def check_video_path(path: str | Path) -> Path:
    """Return `path` as an absolute path of a regular, non-empty file, or of a folder of pictures.

    Raises
    ------
    StrandcastError
        SC-V001 it is an address, a protocol or a pattern; SC-V002 it is missing (near names are listed);
        SC-V003 it is not a regular file; SC-V004 it is empty.
    """
    text = str(path)
    if re.match(r"^[a-zA-Z][a-zA-Z0-9+.-]+:", text):
        raise StrandcastError(
            "SC-V001", f"{text!r} is not a file of this machine: addresses and protocols are not opened",
            file=text, fix="copy the video here and give its path")  # fmt: skip
    file = Path(path)
    if not file.exists():
        pattern = " (patterns such as %03d are not opened)" if "%" in text else ""
        raise StrandcastError("SC-V002", f"the video is not there{pattern}", file=text, fix=_near_names(file))
    if file.is_dir() and any(entry.suffix.lower() in IMAGES for entry in file.iterdir()):
        return file.resolve()
    if not file.is_file():
        raise StrandcastError(
            "SC-V003", "is not a regular file, nor a folder of pictures", file=text,
            fix=f"give the video file itself, or a folder of pictures ({', '.join(IMAGES)})")  # fmt: skip
    if file.stat().st_size == 0:
        raise StrandcastError(
            "SC-V004", "the video is empty (0 bytes)", file=text, exit_code=INTEGRITY,
            fix="copy it again from the camera")  # fmt: skip
    return file.resolve()


def _near_names(file: Path) -> str:
    names = sorted(entry.name for entry in file.parent.iterdir()) if file.parent.is_dir() else []
    near = difflib.get_close_matches(file.name, names, n=3) or names[:3]
    if not near:
        return f"put the video into {file.parent}"
    return f"in {file.parent} there is: {', '.join(near)}"


def files_of(path: str | Path) -> list[Path]:
    """Return the files that a video consists of: itself, Photron's pair, or the pictures of a folder."""
    file = Path(path)
    if file.is_dir():
        return sorted(entry for entry in file.iterdir() if entry.suffix.lower() in IMAGES)
    if file.suffix.lower() in PHOTRON:
        return sorted(
            entry
            for entry in file.parent.iterdir()
            if entry.stem == file.stem and entry.suffix.lower() in PHOTRON
        )
    return [file]


def video_sha256(path: str | Path) -> tuple[str, int]:
    """Return hash and size (bytes) of a video.

    The hash of several files is that of the lines that ``sha256sum`` prints for them in alphabetic order.
    """
    files = files_of(path)
    size = sum(file.stat().st_size for file in files)
    if len(files) == 1:
        return sha256_file(files[0]), size
    lines = "".join(f"{sha256_file(file)}  {file.name}\n" for file in files)
    return hashlib.sha256(lines.encode()).hexdigest(), size
