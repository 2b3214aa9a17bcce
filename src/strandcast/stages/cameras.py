"""The record of an experiment's camera."""

import sys
from pathlib import Path

from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera
from strandcast.stages.context import Context

FORMER = "camera.json"  # the place of the only camera's record up to version 0.1


def read_camera(context: Context, path: Path) -> Camera:
    """Return the record of a camera.

    Raises
    ------
    StrandcastError
        SC-W030 the record is only in its former place.
    """
    former = context.folder.results / FORMER
    if former.is_file() and not path.is_file():
        raise StrandcastError(
            "SC-W030",
            f"the camera's record is now {path.relative_to(context.folder.results)}",
            file=former,
            fix=f"if you supplied it, move it there; else run `strandcast stage calibrate {context.name}`",
        )
    return Camera.read(path)


def warn_of_former(context: Context) -> None:
    """Warn of a record in its former place, which no stage reads."""
    former = context.folder.results / FORMER
    if former.is_file():
        now = context.folder.camera(context.settings.camera_name)
        print(f"warning: {former} is not read; the camera's record is now {now}", file=sys.stderr)
