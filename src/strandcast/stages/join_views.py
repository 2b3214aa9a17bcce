"""What several cameras saw of a throw, each with its own clock, to a track in space."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from strandcast.camera.mapping import pixel_to_metre
from strandcast.camera.stereo import stereo_pose
from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.imports.capture import CapturedTrial, supplied_summary
from strandcast.imports.clock import supplied_clock
from strandcast.imports.track_checks import check_track, paths_of
from strandcast.reconstruction.views import SpaceReconstruction, StringView, reconstruct_in_space
from strandcast.records.alignment import HAND, Alignment, EndPath, end_columns
from strandcast.records.camera import Camera
from strandcast.records.files import sha256_file
from strandcast.records.manifest import Manifest
from strandcast.records.observations import read_observations
from strandcast.records.tables import write_table
from strandcast.records.track import SUPPLIED, TRACK, Track, TrackSummary
from strandcast.stages.calibrate import read_photos_of
from strandcast.stages.job import Files, Job

LARGEST_RMS_PX = 1.0  # chosen: of a board's corners; still boards and good lenses have a few tenths
DISAGREE_M = 2e-3  # chosen: between the poses of boards and of the plane's markers, in the plane
# The cameras' world has y up and z towards the camera; a string in space has z up.
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def run(job: Job, files: Files) -> None:
    """Write track, summary, alignment and hand of one trial; the track has the frames of the first camera."""
    manifests = [Manifest.read(path) for path in files.inputs("manifests")]
    _refuse_same_film(job, manifests)
    summaries = [TrackSummary.read(path) for path in files.inputs("summaries")]
    length_m = summaries[0].length_m
    seen, warnings = _placed_by_boards(job, files, _views(job, files))
    found = reconstruct_in_space(seen, length_m)
    track = _z_up(found)
    points = track.points_m.shape[1] - 1
    known = CapturedTrial(job.context.name, job.trial, length_m, points)
    summary = supplied_summary(track, known, [*range(1, points + 1)])
    summary.choices = {"ends_px": found.ends_px, "ends_sigma": found.ends_sigma}
    summary.cameras = list(job.context.settings.cameras)
    summary.warnings = [*found.warnings, *warnings, *_warnings_of_views(seen, summaries, manifests)]
    summary.faults = [fault for each in summaries for fault in each.faults]
    # All cameras see the same end; what only one of them doubts, as a plane, two of them measure.
    summary.tip_sigma_m = min(each.tip_sigma_m for each in summaries)
    hand_m = track.points_m[:, 0]
    held = np.isfinite(hand_m).all(axis=1)
    hand = {
        "source": np.full(int(held.sum()), "measured", dtype=object),
        "robot_time_s": track.camera_time_s[held],
        **end_columns([EndPath(hand_m[held], None, None)]),
    }
    time_s = track.camera_time_s
    of_motion = float(time_s[0]), float(time_s[-1])
    alignment = supplied_clock(job.context.name, job.trial, len(time_s), of_motion)
    file = files.output("track")
    summary.warnings += check_track(track, paths_of(hand, file), alignment, summary, file)
    write_table(file, TRACK, track.columns())
    write_table(files.output("hand"), HAND, hand)
    alignment.write(files.output("alignment"))
    summary.write(files.output("summary"))


def _views(job: Job, files: Files) -> list[StringView]:
    """Return what each camera saw, by the camera's name."""
    inputs = (files.inputs(role) for role in ("observations", "cameras", "alignments"))
    names = job.context.settings.cameras
    return [
        StringView(name, read_observations(pixels).string, Camera.read(record), Alignment.read(clock))
        for name, pixels, record, clock in zip(names, *inputs, strict=True)
    ]


def _refuse_same_film(job: Job, manifests: list[Manifest]) -> None:
    """Refuse a film that two cameras have: one of them would count twice."""
    for one, other in combinations([each.video for each in manifests], 2):
        _refuse_same(job.folder.data / one.file, job.folder.data / other.file, one.sha256 == other.sha256)


def _refuse_same(one: Path, other: Path, same: bool) -> None:
    """Refuse a file that is another camera's."""
    if same:
        what = f"is {one.relative_to(one.parents[1])}, byte for byte"
        fix = "copy this camera's own file"
        raise StrandcastError("SC-V023", what, file=other, fix=fix, exit_code=INTEGRITY)


def _warnings_of_views(
    views: list[StringView], summaries: list[TrackSummary], manifests: list[Manifest]
) -> Iterator[str]:
    """Yield the warnings of the cameras' records, each with the camera's name."""
    for view, summary, manifest in zip(views, summaries, manifests, strict=True):
        records = (manifest, view.camera, view.camera.lens, summary, view.clock)
        yield from (f"{view.name}: {text}" for record in records for text in record.warnings)


def _placed_by_boards(job: Job, files: Files, views: list[StringView]) -> tuple[list[StringView], list[str]]:
    """Return the views with the poses that photos of boards give the others by the first, and warnings.

    Photos that the first camera and another took at once have the same name in the folders of both.
    """
    by_camera: dict[str, dict[str, Path]] = defaultdict(dict)
    for path in files.inputs("boards"):
        by_camera[path.parent.name][path.stem] = path
    photos = [by_camera[view.name] for view in views]
    warnings: list[str] = []
    for k in range(1, len(views)):
        if both := sorted(photos[0].keys() & photos[k].keys()):
            pair = [[each[name] for name in both] for each in (photos[0], photos[k])]
            for one, other in zip(*pair, strict=True):
                _refuse_same(one, other, sha256_file(one) == sha256_file(other))
            views[k], doubts = _placed(job, views[0], views[k], pair)
            warnings += doubts
        elif photos[0] or photos[k]:
            what = f"no photo of a board, both-*, is there for {views[0].name} and for {views[k].name}"
            fix = "give the photos that two cameras took at once the same name"
            raise StrandcastError("SC-C030", what, file=job.context.folder.data, fix=fix)
    return views, warnings


def _placed(
    job: Job, first: StringView, other: StringView, paths: list[list[Path]]
) -> tuple[StringView, list[str]]:
    """Return the other view with the pose that the boards give it, and a warning if the markers disagree."""
    board = job.context.settings.cameras[first.name].board
    pairs = zip(*(read_photos_of(job.context, each) for each in paths), strict=True)
    pose = stereo_pose(list(pairs), board, first.camera, other.camera)
    camera = pose.placed(first.camera, other.camera)
    seen_px = other.pixels.points_px
    moved_m = pixel_to_metre(camera, seen_px) - pixel_to_metre(other.camera, seen_px)
    median_m = float(np.nanmedian(np.linalg.norm(moved_m, axis=-1)))
    warnings = []
    if pose.rms_px > LARGEST_RMS_PX:
        warnings.append(
            f"the boards' corners are {pose.rms_px:.2f} px (rms) off in {pose.pairs} pairs of photos for "
            f"{other.name}: a board moved between two photos, or the lenses are wrong; take the photos again"
        )
    if median_m >= DISAGREE_M:
        warnings.append(
            f"the boards ({pose.pairs} pairs, {pose.rms_px:.2f} px) place {other.name} so that the string "
            f"moves by {1e3 * median_m:.1f} mm against the plane's markers: measure these again; the boards "
            "count"
        )
    return replace(other, camera=camera), warnings


def _z_up(found: SpaceReconstruction) -> Track:
    """Return the track on the robot's clock, in a world with z up."""
    track = found.track
    assert track.covariance_m2 is not None
    return Track(
        track.frame,
        found.robot_time_s,
        track.points_m @ Z_UP.T,
        track.sigma_m,
        np.where(np.isfinite(track.sigma_m), track.flags | SUPPLIED, 0).astype(np.int32),
        Z_UP @ track.covariance_m2 @ Z_UP.T,
    )
