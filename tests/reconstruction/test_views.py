"""A string that leaves the plane, from two cameras: errors, stated errors, and faults that must show."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from strandcast.camera.stereo import StereoPose
from strandcast.core.interpolation import lagrange_weights
from strandcast.errors import StrandcastError
from strandcast.imports.capture import CapturedTrial, supplied_summary
from strandcast.reconstruction.one_clock import pixels_at
from strandcast.reconstruction.rays import rays_of
from strandcast.reconstruction.string_in_space import string_in_space
from strandcast.reconstruction.triangulate import INCONSISTENT, ONE_CAMERA, PARALLEL, triangulate
from strandcast.reconstruction.views import reconstruct_in_space
from strandcast.records.alignment import HAND
from strandcast.records.folders import ExperimentFolder
from strandcast.records.manifest import Manifest, VideoFacts
from strandcast.records.observations import MarkerPixels, Observations, StringPixels, write_observations
from strandcast.records.tables import read_table
from strandcast.records.track import OCCLUDED, UNSURE, Track, TrackSummary, read_track
from strandcast.stages import join_views
from strandcast.stages.run import run_stage

from .two_views import (
    LEFT,
    LENGTH_M,
    POINTS,
    RIGHT,
    TO_PLANE,
    camera_at,
    clock,
    even_points,
    pixels,
    seen_by,
    string_nodes,
    string_view,
)

TIME_S = np.arange(0.0, 1.2, 0.008)


def rays_with(noise_px, cameras, points_m, seed=1):
    """Rays of points in space, with independent pixel noise."""
    random = np.random.default_rng(seed)
    views = []
    for camera in cameras:
        seen = pixels(camera, points_m)
        covariance = np.broadcast_to(noise_px**2 * np.eye(2), (*seen.shape, 2))
        views.append(rays_of(seen + random.normal(0.0, noise_px, seen.shape), covariance, camera))
    return views


def normalised(error_m, covariance_m2):
    """Errors over their stated standard errors, one number per axis."""
    return np.linalg.solve(np.linalg.cholesky(covariance_m2), error_m[..., None])[..., 0]


def rms_m(error_m):
    return float(np.sqrt((error_m**2).sum(axis=-1).mean()))


def test_points_are_found_exactly_without_noise():
    points_m = np.random.default_rng(2).uniform(-0.3, 0.3, (200, 3))
    exact = [view._replace(covariance=1e-8 * np.eye(2)) for view in rays_with(0.0, (LEFT, RIGHT), points_m)]
    found = triangulate(exact)
    assert np.abs(found.points_m - points_m).max() < 1e-9
    assert (found.doubts == 0).all()


@pytest.mark.parametrize("cameras", [(LEFT, RIGHT), (LEFT, RIGHT, camera_at(0.0, 0.5))], ids=["two", "three"])
def test_errors_of_points_have_the_stated_size(cameras):
    points_m = np.random.default_rng(3).uniform(-0.3, 0.3, (4000, 3))
    found = triangulate(rays_with(0.3, cameras, points_m))
    z = normalised(found.points_m - points_m, found.covariance_m2)
    assert np.sqrt((z**2).mean()) == pytest.approx(1.0, abs=0.03)
    assert np.sqrt((found.misfit_sigma**2).mean()) == pytest.approx(1.0, abs=0.04)
    depth_m = np.sqrt(found.covariance_m2[:, 2, 2]).mean()
    # Two rays at 0.7 rad, 0.3 px at 1900 px and 2.2 m each: 0.35 mm across, over sqrt(2) sin(0.35) in depth.
    expected_m = 0.3 / 1900 * 2.2 / (np.sqrt(2) * np.sin(0.35))
    assert depth_m == pytest.approx(expected_m, rel=0.15 if len(cameras) == 2 else 0.4)


def test_doubts_are_marked():
    points_m = np.random.default_rng(4).uniform(-0.2, 0.2, (50, 3))
    near = triangulate(rays_with(0.3, (LEFT, camera_at(-0.30)), points_m))
    assert (near.doubts & PARALLEL).all()
    views = rays_with(0.3, (LEFT, RIGHT), points_m)
    views[1].rays[7] = np.nan
    views[1].rays[9, 1] += 20 / 1900  # across the epipolar line
    found = triangulate(views)
    assert found.doubts[7] == ONE_CAMERA
    assert np.isnan(found.points_m[7]).all()
    assert found.doubts[9] == INCONSISTENT
    assert (np.delete(found.doubts, [7, 9]) == 0).all()


@pytest.mark.parametrize(("sway_m", "most_m"), [(0.04, 2.0e-3), (0.12, 2.0e-3)])
def test_curves_locate_material_points_that_point_numbers_do_not(sway_m, most_m):
    nodes_m = string_nodes(TIME_S, sway_m)
    truth_m = even_points(nodes_m)
    views = []
    for k, camera in enumerate((LEFT, RIGHT)):
        seen = seen_by(camera, nodes_m, 0.3, k)
        views.append(rays_of(seen, np.broadcast_to(0.09 * np.eye(2), (*seen.shape, 2)), camera))
    by_number = triangulate(views)
    by_curve = string_in_space(views, LENGTH_M)
    assert rms_m(by_number.points_m - truth_m) > 10e-3
    assert rms_m(by_curve.points_m - truth_m) < most_m
    z = normalised(by_curve.points_m - truth_m, by_curve.covariance_m2)
    assert 0.8 < np.sqrt((z**2).mean()) < 1.3


def test_a_length_that_is_wrong_by_a_percent_costs_little():
    view = [string_view(camera, clock(), seed=k) for k, camera in enumerate((LEFT, RIGHT))]
    truth_m = even_points(string_nodes(view[0].pixels.camera_time_s))
    off_m = rms_m(reconstruct_in_space(view, 1.01 * LENGTH_M).track.points_m - truth_m)
    assert off_m < 6e-3


def views_of(left_clock, right_clock, **changes):
    left = string_view(LEFT, left_clock, seed=1, **changes)
    right = string_view(RIGHT, right_clock, seed=2, rate_hz=240.0, name="right", **changes)
    return [left, right]


LATE = clock("right", offset_s=0.0137, drift=4e-5)


def error_m(found, views):
    truth_m = even_points(string_nodes(found.robot_time_s))
    return found.track.points_m - truth_m


def test_cameras_with_clocks_of_their_own():
    views = views_of(clock("left"), LATE)
    found = reconstruct_in_space(views, LENGTH_M)
    off_m = error_m(found, views)
    known = np.isfinite(off_m).all(axis=-1)
    assert known.mean() > 0.97
    assert rms_m(off_m[known]) < 2e-3
    z = normalised(off_m[known], found.track.covariance_m2[known])
    assert 0.7 < np.sqrt((z**2).mean()) < 1.3
    assert found.warnings == []
    assert found.ends_sigma < 1.5


@pytest.mark.parametrize(
    "fault",
    ["swapped", "clock", "pose"],
)
def test_a_fault_of_the_set_up_is_warned_of(fault):
    views = views_of(clock("left"), LATE)
    if fault == "swapped":
        views = [replace(views[0], camera=RIGHT), replace(views[1], camera=LEFT)]
    if fault == "clock":
        views[1] = replace(views[1], clock=clock("right", offset_s=0.0137 + 0.01, drift=4e-5))
    if fault == "pose":
        moved = RIGHT.model_copy(update={"translation_m": [0.0, 0.006, 2.2]})
        views[1] = replace(views[1], camera=moved)
    found = reconstruct_in_space(views, LENGTH_M)
    assert found.ends_sigma > 4.0
    [warning] = [text for text in found.warnings if "do not fit each other" in text]
    assert "left and right" in warning


@pytest.mark.thorough
def test_an_uncertain_clock_makes_fast_points_uncertain():
    sure = reconstruct_in_space(views_of(clock("left"), LATE), LENGTH_M).track
    late = clock("right", offset_s=0.0137, drift=4e-5, sigma_s=2e-3)
    doubtful = reconstruct_in_space(views_of(clock("left"), late), LENGTH_M).track
    tip = slice(60, None), -1
    assert np.nanmedian(doubtful.sigma_m[tip]) > 4 * np.nanmedian(sure.sigma_m[tip])
    assert doubtful.sigma_m[0, -1] < 2 * sure.sigma_m[0, -1]  # at rest


def test_points_that_one_camera_does_not_see_are_unsure():
    views = views_of(clock("left"), clock("right"))
    views[1].pixels.points_px[100:120, 6:8] = np.nan
    views[1].pixels.flags[140:160, 9] = OCCLUDED
    found = reconstruct_in_space(views, LENGTH_M)
    track = found.track
    assert (track.flags[106:114, 6:8] & UNSURE).all()
    assert (track.flags[148:160, 9] & UNSURE).all()
    off_m = np.linalg.norm(error_m(found, views), axis=-1)
    assert np.nanmax(off_m[106:114, 6:8]) < 15e-3
    assert (track.flags & UNSURE).mean() < 0.1


def test_interpolation_in_time_is_cubic_and_states_its_error():
    view = string_view(LEFT, clock(), noise_px=1e-6)
    time_s = view.pixels.camera_time_s
    wanted_s = time_s[3:-3] + 0.0017
    found = pixels_at(view.pixels, time_s, wanted_s, np.zeros(len(wanted_s)))
    true_px = seen_by(LEFT, string_nodes(wanted_s), 0.0, 0)
    ends_px = (found.points_px - true_px)[:, [0, -1]]
    assert np.sqrt((ends_px**2).mean()) < 0.03
    change_px = np.diff(view.pixels.points_px, axis=0)[3:-2]
    linear = view.pixels.points_px[3:-3] + 0.0017 * 250 * change_px
    assert np.sqrt(((linear - true_px)[:, -1] ** 2).mean()) > 0.1
    stated_px = np.sqrt(found.covariance_px2[:, -1, 0, 0])
    assert (np.abs(ends_px[:, 1, 0]) < 3 * stated_px + 1e-3).mean() > 0.97
    weights = lagrange_weights(np.array([[0.0, 1.0, 2.0, 4.0]]), np.array([2.5]))
    assert weights @ [0.0, 1.0, 8.0, 64.0] == pytest.approx(2.5**3)


def test_nothing_is_interpolated_across_gaps_or_beyond_the_film():
    view = string_view(LEFT, clock())
    pixels_there = view.pixels
    kept = np.ones(len(pixels_there.frame), bool)
    kept[100:110] = False
    names = StringPixels.__dataclass_fields__
    cut = replace(pixels_there, **{name: getattr(pixels_there, name)[kept] for name in names})
    time_s = pixels_there.camera_time_s
    wanted_s = np.array([time_s[0] - 1e-3, time_s[50] + 1e-3, time_s[105], time_s[-1] + 1e-3])
    found = pixels_at(cut, cut.camera_time_s, wanted_s, np.zeros(4))
    assert np.isfinite(found.points_px[:, 0, 0]).tolist() == [False, True, False, False]


def test_views_that_do_not_belong_together_are_refused():
    left, right = views_of(clock("left"), clock("right"))
    with pytest.raises(StrandcastError, match="same time"):
        reconstruct_in_space([left, replace(right, clock=clock("right", offset_s=9.0))], LENGTH_M)
    turned = right.camera.model_copy(update={"translation_m": [0.0, 0.0, -2.2]})
    with pytest.raises(StrandcastError, match="in front of them"):
        reconstruct_in_space([left, replace(right, camera=turned)], LENGTH_M)
    few = [replace(each, pixels=first_points(each.pixels, 4)) for each in (left, right)]
    with pytest.raises(StrandcastError, match="3 mass points"):
        reconstruct_in_space(few, LENGTH_M)


def first_points(seen, count):
    """Only the hand and the first points of what a camera saw."""
    found = {name: getattr(seen, name)[:, :count] for name in ("points_px", "covariance_px2", "flags")}
    return replace(seen, **found)


@pytest.fixture
def cable(tmp_path):
    """An experiment with two cameras, tracked and aligned."""
    folder = ExperimentFolder(tmp_path, "cable")
    folder.data.mkdir(parents=True)
    settings = f"string: {{length_m: {LENGTH_M}, points: {POINTS}}}\ncameras: {{left: {{}}, right: {{}}}}\n"
    (folder.data / "experiment.yaml").write_text(settings)
    for name, view in zip(("left", "right"), views_of(clock(), LATE), strict=True):
        of_view = ExperimentFolder(tmp_path, f"cable/{name}")
        results = of_view.trial(1).results
        empty = np.zeros(0)
        markers = MarkerPixels(empty, empty, empty, np.zeros((0, 4, 2)), np.zeros((0, 4, 2, 2)), empty)
        write_observations(results / "observations.parquet", Observations(name, view.pixels, markers, {}))
        view.camera.write(of_view.camera(name))
        view.clock.write(results / "alignment.json")
        summary_of(name).write(results / "track.json")
        manifest_of(name).write(results / "manifest.json")
    return folder


def manifest_of(camera):
    of_file = {
        "file": f"{camera}.mp4",
        "sha256": camera,
        "size_bytes": 1,
        "container": "mov",
        "codec": "h264",
    }
    picture = {
        "pixel_format": "gray",
        "width_px": 1280,
        "height_px": 1024,
        "header_frames": None,
        "packets": 2,
    }
    clock = {"frame_rate_hz": 240.0, "frame_rate_source": "time stamps", "time_base_s": 1 / 240}
    video = VideoFacts(**of_file, **picture, **clock, time_stamps=[0, 1], gaps=[], duplicates=0)
    known = {"experiment": f"cable/{camera}", "trial": 1, "joint_log": None, "motion_sha256": None}
    return Manifest(video=video, warnings=["it is slow"], **known)


def summary_of(camera, tip_sigma_m=0.0):
    known = CapturedTrial(f"cable/{camera}", 1, LENGTH_M, POINTS)
    nothing = np.zeros((2, POINTS + 1, 2))
    track = Track(np.arange(2), np.arange(2.0), nothing, nothing[..., 0], nothing[..., 0].astype(np.int32))
    return supplied_summary(track, known, [1]).model_copy(update={"tip_sigma_m": tip_sigma_m})


def joined(cable):
    """Join the cameras of the trial, and return its summary."""
    run_stage("join_views", cable.root, "cable", 1)
    return TrackSummary.read(cable.trial(1).results / "track.json")


def test_two_cameras_make_one_track_in_space(cable):
    summary = joined(cable)
    expected = "jump", "it is slow"  # its tip is faster than 5 m/s
    assert not [text for text in summary.warnings if not any(words in text for words in expected)]
    assert summary.choices["ends_sigma"] < 1.5
    assert summary.cameras == ["left", "right"]
    results = cable.trial(1).results
    track = read_track(results / "track.parquet", POINTS)
    truth_m = even_points(string_nodes(track.camera_time_s)) @ TO_PLANE  # z up
    assert np.sqrt(np.nanmean(((track.points_m - truth_m) ** 2).sum(axis=-1))) < 2e-3
    known = np.isfinite(track.sigma_m)
    z = normalised((track.points_m - truth_m)[known], track.covariance_m2[known])
    assert 0.7 < np.sqrt((z**2).mean()) < 1.3
    hand = read_table(results / "hand.parquet", HAND)
    assert np.abs(hand["z_m"] - 0.25).max() < 2e-3  # the hand moves level


def test_what_both_cameras_doubt_about_the_tip_stays_in_doubt(cable):
    for name, sigma_m in (("left", 1e-3), ("right", 3e-3)):
        file = ExperimentFolder(cable.root, f"cable/{name}").trial(1).results / "track.json"
        warned = summary_of(name, sigma_m).model_copy(update={"warnings": ["it blurs"]})
        warned.write(file)
    summary = joined(cable)
    assert summary.tip_sigma_m == 1e-3
    assert {f"{camera}: it {does}" for camera in ("left", "right") for does in ("blurs", "is slow")} <= {
        *summary.warnings
    }


def test_a_third_camera_may_see_less_of_the_throw():
    points_m = even_points(string_nodes(TIME_S[:8]))
    views = rays_with(0.3, (LEFT, RIGHT, camera_at(0.1)), points_m)
    alone = string_in_space(views[:2], LENGTH_M)
    views[2].rays[:3] = np.nan
    views[2].rays[3, 1:] = np.nan  # the hand only
    found = string_in_space(views, LENGTH_M)
    assert rms_m(found.points_m - points_m) < 2e-3
    np.testing.assert_allclose(found.points_m[:3], alone.points_m[:3], atol=1e-6)


@pytest.mark.thorough
def test_boards_correct_a_camera_that_the_markers_misplace(cable, monkeypatch):
    moved = RIGHT.model_copy(update={"translation_m": [0.0, 0.006, 2.2]})
    moved.write(ExperimentFolder(cable.root, "cable/right").camera("right"))
    assert any("do not fit each other" in text for text in joined(cable).warnings)
    for name, count in (("left", 4), ("right", 3)):
        folder = cable.data / "calibration" / name
        folder.mkdir(parents=True)
        for k in range(count):
            cv2.imwrite(str(folder / f"both-{k}.png"), np.full((8, 8), 10 * k + (name == "right"), np.uint8))
    turn = np.array(RIGHT.rotation) @ np.array(LEFT.rotation).T
    shift_m = np.array(RIGHT.translation_m) - turn @ np.array(LEFT.translation_m)

    def boards_pose(photos, board, first, second):
        assert [(int(one[0, 0]), int(other[0, 0])) for one, other in photos] == [(0, 1), (10, 11), (20, 21)]
        return StereoPose(turn, shift_m, len(photos), 0.1)

    monkeypatch.setattr(join_views, "stereo_pose", boards_pose)
    right = joined(cable)
    assert not any("do not fit each other" in text for text in right.warnings)
    [warning] = [text for text in right.warnings if "boards" in text]
    assert "3 pairs" in warning
    assert "moves by 6.0 mm" in warning
    assert right.choices["ends_sigma"] < 1.5
    for photo in (cable.data / "calibration" / "right").iterdir():
        photo.rename(photo.with_name(photo.name.replace("both-", "both-right-")))
    with pytest.raises(StrandcastError, match="SC-C030.*for left and for right"):
        joined(cable)
