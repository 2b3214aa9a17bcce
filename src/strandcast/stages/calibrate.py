"""Board photos or video, and the plane's photo, to camera.json and a picture of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from strandcast.camera.lens import calibrate_lens, calibrate_lens_video
from strandcast.camera.markers import CharucoBoard
from strandcast.camera.picture import camera_picture
from strandcast.camera.plane import PlaneKnowledge, PlaneMarker, board_markers, plane_from_markers
from strandcast.errors import StrandcastError
from strandcast.experiment import Board, Experiment, Plane
from strandcast.progress import progress
from strandcast.records.camera import Camera, Lens
from strandcast.records.files import atomic_write
from strandcast.records.manifest import Manifest
from strandcast.stages.context import Context, context_of
from strandcast.tracking.arc import calibrate_arc
from strandcast.video.ingest import inspect_video
from strandcast.video.reader import open_video

LOOKED_AT = 150  # frames of a lens video in which the board is looked for
# As the sensor has it: a phone's note on how to turn a picture would turn the lens about.
AS_IT_IS = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION


def run(root: Path, name: str) -> None:
    """Write results/<experiment>/{camera.webp, camera.json}."""
    context = context_of(root, name)
    if context.settings.camera.scale == "arc":
        camera, picture = _by_arc(context)
    else:
        camera, picture = _by_markers(context)
    with atomic_write(context.folder.results / "camera.webp") as temporary:
        Image.fromarray(camera_picture(picture, camera)).save(temporary, "WEBP", quality=82, method=4)
    camera.write(context.folder.results / "camera.json")


def _by_markers(context: Context) -> tuple[Camera, np.ndarray]:
    """Take the lens from the board's photos or video, the plane from the photo of its markers or board."""
    settings = context.settings
    plane = context.folder.data / settings.camera.plane_photo
    picture = _photo(plane)
    markers, dictionary = plane_markers_of(settings.camera.plane)
    camera = plane_from_markers(
        picture, _lens(context), markers, dictionary, file=str(plane), knowledge=_knowledge(settings)
    )
    return camera, picture


def _knowledge(settings: Experiment) -> PlaneKnowledge:
    camera, box = settings.camera, settings.workspace_m
    return PlaneKnowledge(
        camera.string_offset_m,
        camera.string_offset_sd_m,
        camera.plane.place_sd_m,
        None if box is None else (box.x_m, box.y_m),
    )


def _lens(context: Context) -> Lens:
    camera, folder = context.settings.camera, context.folder.data
    if camera.lens_video is not None:
        frames = _board_frames(folder / camera.lens_video)
        return calibrate_lens_video(frames, charuco_of(camera.board), camera.distortion)
    paths = sorted(folder.glob(camera.lens_photos))
    if not paths:
        there = sorted(path.name for path in (folder / camera.lens_photos).parent.glob("*"))
        raise StrandcastError(
            "SC-C030",
            f"no photo fits {camera.lens_photos!r}; there: {', '.join(there[:12]) or 'nothing'}",
            file=folder,
            field="camera.lens_photos",
            fix="take 10 photos of the ChArUco board, all over the picture (`strandcast boards` prints it)",
        )
    photos = [(path.name, _photo(path)) for path in progress(paths, "calibrate: photos", len(paths))]
    return calibrate_lens(photos, charuco_of(camera.board), camera.distortion)


def _board_frames(path: Path) -> Iterator[tuple[str, np.ndarray]]:
    """Yield frames spread evenly over the board's video, named by their numbers."""
    every = max(1, inspect_video(path).packets // LOOKED_AT)
    with open_video(path) as video:
        for index, _, grey in video:
            if index % every == 0:
                yield f"{path.name} frame {index}", grey


def _by_arc(context: Context) -> tuple[Camera, np.ndarray]:
    """Take scale and origin from the first trial's pendulum, whose length is known."""
    first = context.folder.trial(1)
    video = Manifest.read(first.results / "manifest.json").video
    settings, path = context.settings, first.data / video.file
    camera = calibrate_arc(path, video, settings.string.length_m, settings.track.background_frames)
    with open_video(path) as frames:
        _, _, grey = next(iter(frames))
        return camera, grey.copy()


def _photo(path: Path) -> np.ndarray:
    if not path.is_file():
        raise StrandcastError("SC-C031", "the photo is not there", file=path, fix="take it, and put it there")
    grey = cv2.imread(str(path), AS_IT_IS)
    if grey is None:
        raise StrandcastError("SC-C032", "is not a picture", file=path, fix="copy it again")
    return np.asarray(grey)


def charuco_of(board: Board) -> CharucoBoard:
    """Return a board of the experiment's file."""
    return CharucoBoard(
        board.squares_x, board.squares_y, board.square_m, board.marker_m, board.dictionary, board.legacy
    )


def plane_markers_of(plane: Plane) -> tuple[list[PlaneMarker], str]:
    """Return the plane's markers, single ones or those of the board lying in it, and their dictionary."""
    if plane.board is not None:
        board = plane.board
        return board_markers(charuco_of(board), board.x_m, board.y_m, board.angle_rad), board.dictionary
    single = [PlaneMarker(m.id, m.x_m, m.y_m, plane.size_m, m.angle_rad) for m in plane.markers]
    return single, plane.dictionary
