"""Photos of the board and of the plane of motion to the camera record, and a picture of the result."""

import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from strandcast.camera.distortion import FISHEYE
from strandcast.camera.lens import calibrate_lens, calibrate_lens_video
from strandcast.camera.lens_file import read_lens
from strandcast.camera.markers import patterned
from strandcast.camera.plane import board_markers, plane_from_markers, unmeasured_offset_warnings
from strandcast.camera.pose import PlacedMarker
from strandcast.camera.printed_board import PrintedBoard, identify_board
from strandcast.config.camera import CameraSettings
from strandcast.errors import StrandcastError
from strandcast.progress import progress
from strandcast.records.camera import Camera, Lens
from strandcast.records.files import atomic_write
from strandcast.records.folders import parted
from strandcast.records.lineage import note_picture
from strandcast.records.manifest import Manifest
from strandcast.stages.context import Context
from strandcast.stages.job import Files, Job
from strandcast.stages.photos import given_pictures
from strandcast.video.isolated import probe_isolated
from strandcast.video.reader import open_video

PARTLY = (
    "squares_x and squares_y of camera.plane.board, its pattern and its first id are not checked where it is "
    "cut off; a wrong one would move the world by whole squares"
)
FORMER = "camera.json"  # the place of the only camera's record up to version 0.1
SEARCHED_FRAMES = 150  # frames of a lens video in which the board is searched; chosen, not sensitive
# As the sensor recorded it: a phone's orientation tag would rotate the lens model too.
UNROTATED = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION


def run(job: Job, files: Files) -> None:
    """Write the camera's picture and record."""
    from strandcast.camera.picture import camera_picture  # heavy: others read photos with this module

    _warn_of_former(job.context)
    fit = _by_tracker if job.context.settings.tracker_finds_scale else camera_by_markers
    camera, picture = fit(job.context, files)
    with atomic_write(files.output("picture")) as temporary:
        Image.fromarray(camera_picture(picture, camera)).save(temporary, "WEBP", quality=82, method=4)
    note_picture(files.output("picture"))
    camera.write(files.output("camera"))


def _warn_of_former(context: Context) -> None:
    """Warn of a record in its former place, which no stage reads."""
    former = context.folder.results / FORMER
    if former.is_file():
        now = context.folder.camera(context.settings.camera_name)
        print(f"warning: {former} is not read; the camera's record is now {now}", file=sys.stderr)


def camera_by_markers(context: Context, files: Files) -> tuple[Camera, np.ndarray]:
    """Fit the lens to photos or a video of the board, the plane to a photo of its markers or board."""
    settings, plane, box = context.settings, files.input("plane"), context.settings.workspace_m
    [picture] = read_photos_of(context, [plane])
    lens, printed = _lens(context, files)
    markers, dictionary, shown, warnings = plane_markers_of(settings.camera, picture, str(plane), printed)
    offset_m, offset_sd_m = settings.camera.string_offset_and_sd_m
    camera = plane_from_markers(
        *(shown, lens, markers, dictionary),
        file=str(plane),
        string_offset_m=offset_m,
        string_offset_sd_m=offset_sd_m,
        place_sd_m=settings.camera.plane.place_sd_m,
        workspace_m=None if box is None else (box.x_m, box.y_m),
        on_board=settings.camera.plane.board is not None,
    )
    camera.warnings = warnings + camera.warnings
    alone = not parted(context.name)[1]  # several cameras see where the string is
    if settings.lab is None and alone and "string_offset_m" not in settings.camera.model_fields_set:
        camera.warnings += unmeasured_offset_warnings(camera)
    return camera, picture


def _lens(context: Context, files: Files) -> tuple[Lens, PrintedBoard | None]:
    """Return the lens, and the board as its photos show it."""
    camera = context.settings.camera
    if camera.lens_kind == "file":
        return read_lens(files.input("lens"), camera.lens_name, camera.distortion == FISHEYE), None
    if camera.lens_kind == "video":
        frames = _board_frames(files.input("lens"))
        return calibrate_lens_video(frames, camera.board, camera.distortion)
    paths = files.inputs("lens")
    read = progress(read_photos_of(context, paths), "calibrate: photos", len(paths))
    photos = [(path.name, grey) for path, grey in zip(paths, read, strict=True)]
    return calibrate_lens(photos, camera.board, camera.distortion)


def _board_frames(path: Path) -> Iterator[tuple[str, np.ndarray]]:
    """Yield frames spread evenly over the board's video, named by their numbers."""
    every = max(1, len(probe_isolated(path).ticks) // SEARCHED_FRAMES)
    with open_video(path) as video:
        for index, _, grey in video:
            if index % every == 0:
                yield f"{path.name} frame {index}", grey


def _by_tracker(context: Context, files: Files) -> tuple[Camera, np.ndarray]:
    """Let the tracker find scale and origin in the film of the first trial."""
    from strandcast.tracking.registry import TRACKERS  # heavy: not for every calibration

    settings = context.settings
    tracker = TRACKERS.get(settings.track.tracker, context.file)
    if tracker.calibrate is None:
        what = f"the plane has no markers, and the tracker {settings.track.tracker!r} finds no scale"
        fix = "give the plane's markers with their places, or its board"
        raise StrandcastError("SC-E008", what, file=context.file, field="camera.plane", fix=fix)
    video = Manifest.read(files.input("manifest")).video
    path = context.folder.trial(1).data / video.file
    return tracker.calibrate(path, video, settings.string.length_m, settings.track)


def read_photos_of(context: Context, paths: list[Path]) -> Iterator[np.ndarray]:
    """Yield the experiment's photos, grey as the sensor recorded them."""
    for path, grey in zip(paths, given_pictures(context, paths, UNROTATED), strict=True):
        if grey is None:
            raise StrandcastError("SC-C031", "is not a readable picture", file=path)
        yield grey


def plane_markers_of(
    camera: CameraSettings, picture: np.ndarray, file: str, of_lens: PrintedBoard | None = None
) -> tuple[list[PlacedMarker], str, np.ndarray, list[str]]:
    """Return the plane's markers, their dictionary, the picture with them black on white, and warnings.

    The markers are single ones, or those of the board lying in the plane, in the pattern and with the ids
    that the plane's `picture` (height, width) in `file` shows; a warning names what is declared otherwise.
    `of_lens` is the lens photos' board as they show it: the plane's, where both are declared alike and the
    plane's is cut off.
    """
    plane = camera.plane
    if plane.board is None:
        single = [PlacedMarker(m.id, m.x_m, m.y_m, plane.size_m, m.angle_rad) for m in plane.markers]
        return single, plane.dictionary, picture, []
    placed, declared = plane.board, camera.board.model_dump()
    proven = of_lens is not None and of_lens.is_shown and declared.items() <= placed.model_dump().items()
    usual = of_lens.board if of_lens is not None and proven else patterned(placed)
    shown = identify_board([(file, picture)], usual, "camera.plane.board")
    use_proven = proven and not shown.is_shown and shown.board == usual
    board = usual if use_proven else shown.board
    warnings = [*(shown.of_size if use_proven else shown.warnings)]
    if shown.is_open and not use_proven:
        what, fix = "the board is cut off in the photo, and may have other ids", "photograph all of it"
        raise StrandcastError("SC-C016", what, file=file, field="camera.plane.board", fix=fix)
    if not (shown.is_shown or use_proven):
        warnings = [*warnings, f"{file} does not show all of the board: {PARTLY}"]
    markers = board_markers(board, placed.x_m, placed.y_m, placed.angle_rad)
    return markers, placed.dictionary, shown.black_on_white(picture), warnings
