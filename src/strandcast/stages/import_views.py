"""Import a throw that several cameras filmed, each in an experiment of its own, as a track in space."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from strandcast.camera.mapping import pixel_to_metre
from strandcast.camera.stereo import stereo_pose
from strandcast.errors import StrandcastError
from strandcast.imports.capture import CapturedTrial, supplied_summary, write_capture
from strandcast.imports.clock import supplied_clock
from strandcast.imports.track_checks import check_track, paths_of
from strandcast.reconstruction.views import SpaceReconstruction, StringView, reconstruct_in_space
from strandcast.records.alignment import Alignment, EndPath, end_columns
from strandcast.records.camera import Camera
from strandcast.records.files import sha256_file
from strandcast.records.observations import read_observations
from strandcast.records.track import SUPPLIED, Track, TrackSummary
from strandcast.stages.calibrate import read_photos_of
from strandcast.stages.context import Context, context_of, refuse_other_target, refuse_replacing

OBSERVATIONS = "observations.parquet"
LENGTHS_DIFFER = 0.02  # chosen: a length that is 5 % wrong moves points by 1 mm, one of 15 % by 50 mm
LARGEST_RMS_PX = 1.0  # chosen: of a board's corners; still boards and good lenses have a few tenths
DISAGREE_M = 2e-3  # chosen: between the poses of boards and of the plane's markers, in the plane
# The cameras' world has y up and z towards the camera; a string in space has z up.
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def run(
    root: Path,
    name: str,
    trial: int,
    views: list[tuple[str, int]],
    overwrite: bool = False,
    boards: str | None = None,
) -> TrackSummary:
    """Join the observations of trials of other experiments; `register_track` copies the track to the results.

    Parameters
    ----------
    name, trial
        The experiment in space and its trial.
    views
        Experiment and trial of each camera; the track has the frames of the first.
    boards
        Pattern of photos of the lens board that all cameras took at once, under the same names in the folder
        of each one's experiment. They place the other cameras by the first, instead of the plane's markers.
    """
    context = context_of(root, name)
    folder = context.folder.trial(trial)
    refuse_replacing(folder.data / "track.json", overwrite)
    refuse_other_target(context, True)
    if context.settings.aims_in_space:
        raise StrandcastError(
            "SC-I046",
            "cameras do not see in which direction an arm's hand holds the string",
            file=context.file,
            field="target_m",
            fix="measure throws in space by motion capture: strandcast import track",
        )
    length_m = context.settings.string.length_m
    cameras = [experiment for experiment, _ in views]
    if len(set(cameras)) < len(cameras):
        what = f"{' and '.join(cameras)} are one camera, and its trials are different throws"
        raise StrandcastError("SC-I049", what, field="--view", fix="name each camera's own experiment once")
    of_views = [(context_of(root, experiment), number) for experiment, number in views]
    tip_sigma_m = [_checked_track(*each, length_m) for each in of_views]
    seen = [_view(*each) for each in of_views]
    warnings = []
    if boards is not None:
        for k in range(1, len(seen)):
            contexts = of_views[0][0], of_views[k][0]
            seen[k], doubts = _placed_by_boards(contexts, seen[0], seen[k], boards)
            warnings += doubts
    found = reconstruct_in_space(seen, length_m)
    track = _z_up(found)
    points = track.points_m.shape[1] - 1
    summary = supplied_summary(track, CapturedTrial(name, trial, length_m, points), [*range(1, points + 1)])
    summary.median_sigma_m = float(np.nanmedian(track.sigma_m[:, 1:]))
    summary.choices = {"file": OBSERVATIONS, "ends_px": found.ends_px, "ends_sigma": found.ends_sigma}
    for each, number in of_views:
        observations = each.folder.trial(number).results / OBSERVATIONS
        summary.choices[f"{each.name} trial {number}"] = sha256_file(observations)
    summary.warnings = [*found.warnings, *warnings]
    # Both cameras see the same end; what only one of them doubts, as a plane, two of them measure.
    summary.tip_sigma_m = min(tip_sigma_m)
    hand_m = track.points_m[:, 0]
    known = np.isfinite(hand_m).all(axis=1)
    hand = {
        "source": np.full(int(known.sum()), "measured", dtype=object),
        "robot_time_s": track.camera_time_s[known],
        **end_columns([EndPath(hand_m[known], None, None)]),
    }
    time_s = track.camera_time_s
    alignment = supplied_clock(name, trial, len(time_s), (float(time_s[0]), float(time_s[-1])))
    file = folder.data / "track.parquet"
    summary.warnings += check_track(track, paths_of(hand, file), alignment, summary, file)
    write_capture(folder.data, track, hand, alignment, summary)
    return summary


def _view(context: Context, trial: int) -> StringView:
    experiment, folder = context.name, context.folder.trial(trial)
    path = folder.results / OBSERVATIONS
    if not path.is_file():
        raise StrandcastError(
            "SC-W030",
            "this camera's trial has not been tracked",
            file=path,
            fix=f"strandcast run {experiment} --until align",
        )
    camera = context.settings.camera_name
    observed = read_observations(path)
    if camera not in observed:
        what = f"holds {', '.join(observed) or 'nothing'}, and the experiment's camera is {camera}"
        raise StrandcastError("SC-W030", what, file=path, fix=f"strandcast track {experiment} {trial}")
    record = Camera.read(context.folder.camera(camera))
    clock = Alignment.read(folder.results / "alignment.json")
    return StringView(experiment, observed[camera].string, record, clock)


def _checked_track(context: Context, trial: int, length_m: float) -> float:
    """Return how well a camera's track knows the tip [m]; refuse a track of a string of another length."""
    path = context.folder.trial(trial).results / "track.json"
    if not path.is_file():
        return 0.0  # what is missing is reported next
    summary = TrackSummary.read(path)
    its_m = summary.length_m
    if abs(its_m - length_m) > LENGTHS_DIFFER * length_m:
        what = f"the string is {length_m:g} m long, but from the hand on {its_m:.4g} m in {context.name}"
        fix = f"give the free length, without what the clamp holds: length_m: {its_m:.4g}"
        raise StrandcastError("SC-I049", what, field="string.length_m", fix=fix)
    return summary.tip_sigma_m


def _placed_by_boards(
    contexts: tuple[Context, Context], first: StringView, other: StringView, boards: str
) -> tuple[StringView, list[str]]:
    """Return the other view with the pose that the boards give it, and a warning if the markers disagree."""
    folders = [context.folder.data for context in contexts]
    usable = boards and not Path(boards).is_absolute()
    names = sorted(path.relative_to(folders[0]) for path in folders[0].glob(boards)) if usable else []
    both = [name for name in names if (folders[1] / name).is_file()]
    if not both:
        what = f"no file {boards!r} is in both {folders[0]} and {folders[1]}"
        fix = "give a pattern of names in these folders, e.g. 'calibration/both-*.png'"
        raise StrandcastError("SC-I049", what, field="--boards", fix=fix)
    photos = [read_photos_of(c, [f / name for name in both]) for c, f in zip(contexts, folders, strict=True)]
    pose = stereo_pose(
        list(zip(*photos, strict=True)), contexts[0].settings.camera.board, first.camera, other.camera
    )
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
