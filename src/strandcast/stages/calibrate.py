"""Board photos and plane photo to camera.json."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from strandcast.camera.lens import calibrate_lens
from strandcast.camera.markers import CharucoBoard
from strandcast.camera.plane import PlaneMarker, plane_from_markers
from strandcast.errors import StrandcastError
from strandcast.experiment import CameraSettings
from strandcast.progress import progress
from strandcast.records.manifest import Manifest
from strandcast.stages.context import Context, context_of
from strandcast.tracking.arc import calibrate_arc


def run(root: Path, name: str) -> None:
    """Write results/<experiment>/camera.json."""
    context = context_of(root, name)
    camera = context.settings.camera
    if camera.scale == "arc":
        _calibrate_by_arc(context)
        return
    folder = context.folder.data
    paths = sorted(folder.glob(camera.lens_photos))
    photos = [(path.name, _photo(path)) for path in progress(paths, "calibrate: photos", len(paths))]
    if not photos:
        raise StrandcastError(
            "SC-C030",
            f"no photo fits {camera.lens_photos!r}",
            file=folder,
            field="camera.lens_photos",
            fix="take 10 photos of the ChArUco board, all over the picture (`strandcast boards` prints it)",
        )
    lens = calibrate_lens(photos, charuco_of(camera))
    plane = folder / camera.plane_photo
    plane_from_markers(
        _photo(plane),
        lens,
        [PlaneMarker(m.id, m.x_m, m.y_m, camera.plane.size_m, m.angle_rad) for m in camera.plane.markers],
        camera.plane.dictionary,
        camera.string_offset_m,
        file=str(plane),
    ).write(context.folder.results / "camera.json")


def _calibrate_by_arc(context: Context) -> None:
    """Take scale and origin from the first trial's pendulum, whose length is known."""
    first = context.folder.trial(1)
    video = Manifest.read(first.results / "manifest.json").video
    settings = context.settings
    frames = settings.track.background_frames
    calibrate_arc(first.data / video.file, video, settings.string.length_m, frames).write(
        context.folder.results / "camera.json"
    )


def _photo(path: Path) -> np.ndarray:
    if not path.is_file():
        raise StrandcastError("SC-C031", "the photo is not there", file=path, fix="take it, and put it there")
    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if grey is None:
        raise StrandcastError("SC-C032", "is not a picture", file=path, fix="copy it again")
    return np.asarray(grey)


def charuco_of(camera: CameraSettings) -> CharucoBoard:
    """Return the board of the lens photos."""
    board = camera.board
    return CharucoBoard(
        board.squares_x, board.squares_y, board.square_m, board.marker_m, board.dictionary, board.legacy
    )
