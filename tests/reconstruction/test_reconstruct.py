"""Pixels to metres: what the tracker says in metres comes back from observations and camera record alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strandcast.camera.mapping import metre_per_pixel
from strandcast.reconstruction.plane import reconstruct
from strandcast.records.camera import Camera, Lens
from strandcast.records.folders import ExperimentFolder
from strandcast.records.observations import MarkerShape, Observations, read_observations, write_observations
from strandcast.records.tables import read_table
from strandcast.records.track import MARKERS, Track, read_track
from strandcast.stages.run import run_stage
from strandcast.tracking.observe import observe
from strandcast.tracking.result import Tracked, marker_columns

FRAMES, POINTS = 200, 8
SHAPES = {7: MarkerShape(0.04, 0.0), 8: MarkerShape(0.05, 0.02)}


@pytest.fixture(scope="module")
def camera() -> Camera:
    """A camera that looks at the plane at an angle, through a lens with distortion."""
    cosine, sine = np.cos(0.2), np.sin(0.2)
    return Camera(
        lens=Lens(
            width_px=800,
            height_px=600,
            rms_px=0.1,
            distortion=[-0.12, 0.06, 0.0008, -0.0006, 0.02],
            matrix=[[1400.0, 0.0, 399.5], [0.0, 1390.0, 299.5], [0.0, 0.0, 1.0]],
        ),
        rotation=[[1.0, 0.0, 0.0], [0.0, -cosine, sine], [0.0, -sine, -cosine]],
        translation_m=[0.0, 0.0, 2.1],
        plane_rms_px=0.1,
        plane_markers=[],
        string_offset_m=0.012,
        scale_m_per_px=0.0015,
        source="given",
    )


@pytest.fixture(scope="module")
def tracked() -> Tracked:
    """A tracking result with holes, flags, and markers that turn more than once."""
    random = np.random.default_rng(3)
    points_m = random.uniform(-1.0, 1.0, (FRAMES, POINTS + 1, 2)) * [0.5, 0.35]
    points_m[random.random((FRAMES, POINTS + 1)) < 0.1] = np.nan
    points_m[17] = np.nan
    sigma_m = np.where(np.isnan(points_m[..., 0]), np.nan, random.uniform(1e-4, 3e-3, points_m.shape[:2]))
    frame = np.repeat(np.arange(FRAMES), 2)
    angle_rad = np.cumsum(random.normal(0.1, 0.05, (FRAMES, 2)), axis=0).ravel()
    place_m = random.uniform(-0.3, 0.3, (2 * FRAMES, 2))
    spread_m = random.uniform(1e-5, 1e-4, 2 * FRAMES)
    markers = np.column_stack([frame, frame / 500, np.tile([7, 8], FRAMES), place_m, angle_rad, spread_m])
    return Tracked(
        camera_time_s=np.arange(FRAMES) / 500,
        points_m=points_m,
        sigma_m=sigma_m,
        flags=random.integers(0, 5, points_m.shape[:2]).astype(np.int32),
        markers=marker_columns(markers),
        strobe=np.zeros((1, 1, 3), np.uint8),
        choices={},
    )


@pytest.fixture(scope="module")
def seen(tracked: Tracked, camera: Camera) -> Observations:
    return observe(tracked, camera, "main", SHAPES)


@pytest.fixture(scope="module")
def again(
    seen: Observations, camera: Camera, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Track, dict[str, np.ndarray]]:
    path = tmp_path_factory.mktemp("observations") / "observations.parquet"
    write_observations(path, seen)
    return reconstruct(read_observations(path), camera)


def test_points_come_back_to_rounding_with_the_same_sigma_and_flags(again, tracked):
    seen = np.isfinite(tracked.points_m[..., 0])
    frames = np.flatnonzero(seen.any(axis=1))
    track, _ = again
    assert np.array_equal(track.frame, frames)
    assert np.array_equal(track.camera_time_s, tracked.camera_time_s[frames])
    assert np.array_equal(np.isfinite(track.points_m[..., 0]), seen[frames])
    assert np.nanmax(np.abs(track.points_m - tracked.points_m[frames])) < 1e-14
    assert np.array_equal(track.sigma_m[seen[frames]], tracked.sigma_m[seen])
    assert np.array_equal(track.flags[seen[frames]], tracked.flags[seen])


def test_markers_come_back_with_continuous_angles(again, tracked):
    _, markers = again
    assert list(markers) == list(tracked.markers)
    for name in ("frame", "camera_time_s", "marker", "sigma_m"):
        assert np.array_equal(markers[name], tracked.markers[name])
    for name in ("x_m", "y_m", "angle_rad"):
        assert np.abs(markers[name] - tracked.markers[name]).max() < 1e-12
    assert markers["angle_rad"].max() > 2 * np.pi


def test_covariance_is_carried_to_pixels_and_back(again, seen, camera, tracked):
    scale = metre_per_pixel(camera, tracked.points_m, camera.string_offset_m)
    known = np.isfinite(tracked.sigma_m)
    area_px2 = np.sqrt(np.linalg.det(seen.string.covariance_px2[known]))
    assert area_px2 * scale[known] ** 2 == pytest.approx(tracked.sigma_m[known] ** 2, rel=1e-6)
    track, _ = again
    covariance_m2 = track.covariance_m2
    assert covariance_m2 is not None
    assert np.sqrt(covariance_m2[..., 1, 1]) == pytest.approx(track.sigma_m, rel=1e-6, nan_ok=True)
    assert np.nanmax(np.abs(covariance_m2[..., 0, 1])) < 1e-12


def test_without_the_trackers_sigma_it_follows_from_the_covariance(seen, camera, again):
    nothing = replace(seen.string, sigma_m=np.full_like(seen.string.sigma_m, np.nan))
    track, _ = reconstruct(replace(seen, string=nothing), camera)
    stated, _ = again
    assert track.sigma_m[stated.frame] == pytest.approx(stated.sigma_m, rel=1e-6, nan_ok=True)


def test_the_stage_needs_records_alone(seen, camera, tracked, tmp_path: Path):
    folder = ExperimentFolder(tmp_path, "blind")
    folder.data.mkdir(parents=True)
    settings = "string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\ncameras: {side: {}}\n"
    (folder.data / "experiment.yaml").write_text(settings)
    results = folder.trial(1).results
    write_observations(results / "observations.parquet", replace(seen, camera="side"))
    camera.write(folder.camera("side"))
    run_stage("reconstruct", tmp_path, "blind", 1)
    track = read_track(results / "track.parquet", POINTS)
    assert np.nanmax(np.abs(track.points_m - tracked.points_m[track.frame])) < 1e-14
    assert track.covariance_m2 is not None
    assert len(read_table(results / "markers.parquet", MARKERS)["frame"]) == 2 * FRAMES


def test_a_trial_without_markers_gives_an_empty_table(tracked, camera, tmp_path):
    bare = replace(tracked, markers=marker_columns(np.zeros((0, 7))))
    write_observations(tmp_path / "o.parquet", observe(bare, camera, "main", {}))
    track, markers = reconstruct(read_observations(tmp_path / "o.parquet"), camera)
    assert len(markers["frame"]) == 0
    assert len(track.frame) == FRAMES - 1


def test_a_track_in_space_has_a_third_coordinate(tmp_path):
    from strandcast.records.tables import write_table
    from strandcast.records.track import TRACK

    points_m = np.random.default_rng(1).normal(size=(5, 3, 3))
    track = Track(np.arange(5), np.arange(5) / 100, points_m, np.ones((5, 3)), np.zeros((5, 3), np.int32))
    write_table(tmp_path / "track.parquet", TRACK, track.columns())
    assert np.array_equal(read_track(tmp_path / "track.parquet", 2).points_m, points_m)
