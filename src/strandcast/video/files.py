"""The door for video files: regular files that a reader may open, and nothing else."""

import re
from pathlib import Path

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.folders import PICTURES, files_of_video

# hashlib and difflib are imported on use: the process that decodes a video needs neither.


def check_video_path(path: str | Path) -> Path:
    """Return the absolute path of a regular, non-empty file, or of a folder of pictures.

    Raises
    ------
    StrandcastError
        SC-V002 an address, a protocol or a pattern; missing (similar names are listed); not a regular file;
        SC-V005 empty.
    """
    text = str(path)
    if re.match(r"^[a-zA-Z][a-zA-Z0-9+.-]+:", text):
        what = f"{text!r} is not a local file: addresses and protocols are not opened"
        raise StrandcastError("SC-V002", what, file=text, fix="copy the video here and give its path")
    file = Path(path)
    if not file.exists():
        pattern = " (patterns such as %03d are not opened)" if "%" in text else ""
        what = f"the video does not exist{pattern}"
        raise StrandcastError("SC-V002", what, file=text, fix=_similar_names(file))
    if file.is_dir() and any(entry.suffix.lower() in PICTURES for entry in file.iterdir()):
        return file.resolve()
    if not file.is_file():
        what = "is neither a regular file nor a folder of pictures"
        fix = f"give the video file itself, or a folder of pictures ({', '.join(PICTURES)})"
        raise StrandcastError("SC-V002", what, file=text, fix=fix)
    if file.stat().st_size == 0:
        raise damaged("SC-V005", "the video is empty (0 bytes)", text)
    return file.resolve()


def _similar_names(file: Path) -> str:
    import difflib

    names = sorted(entry.name for entry in file.parent.iterdir()) if file.parent.is_dir() else []
    similar = difflib.get_close_matches(file.name, names, n=3) or names[:3]
    if not similar:
        return f"put the video into {file.parent}"
    return f"{file.parent} contains: {', '.join(similar)}"


def damaged(
    code: str,
    what: str,
    file: str | Path,
    field: str | None = None,
    cost: str | None = None,
    fix: str | None = None,
) -> StrandcastError:
    """Return the error for a file that is damaged or incomplete."""
    return StrandcastError(code, what, file=file, field=field, cost=cost, fix=fix, exit_code=INTEGRITY)


def video_sha256(path: str | Path) -> tuple[str, int]:
    """Return hash and size [bytes] of a video.

    The hash of several files is that of the lines that ``sha256sum`` prints for them in alphabetical order.
    """
    import hashlib

    from strandcast.records.known_hashes import content_sha256_of

    files = files_of_video(Path(path))
    size = sum(file.stat().st_size for file in files)
    if len(files) == 1:
        return content_sha256_of(files[0]), size
    lines = "".join(f"{content_sha256_of(file)}  {file.name}\n" for file in files)
    return hashlib.sha256(lines.encode()).hexdigest(), size
