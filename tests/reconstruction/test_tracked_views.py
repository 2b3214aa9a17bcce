"""A string that sways out of the plane, filmed and tracked by two cameras: pictures to places in space."""

import numpy as np
import pytest

from strandcast.camera.mapping import metre_to_pixel
from strandcast.reconstruction.rays import rays_of
from strandcast.reconstruction.triangulate import triangulate
from strandcast.reconstruction.views import StringView, reconstruct_in_space
from strandcast.records.observations import MarkerShape
from strandcast.records.track import UNSURE
from strandcast.tracking.observe import observe

from ..tracking import scene
from .two_views import camera_at, clock, even_points, pixels

LENGTH_M, POINTS = 0.3, 10
SWAY_RAD, SWAY_HZ = 0.5, 3.0


def camera_from(turn_rad, lift_rad=0.0):
    """The scene's camera, looking from another direction."""
    flat = scene.flat_camera()
    rotation = camera_at(turn_rad, lift_rad).rotation
    return flat.model_copy(update={"rotation": rotation})


def tracked(name, camera, monkeypatch, folder, seed):
    """What the tracker sees of the swaying string with one camera, and the true curves (F, K, 3)."""
    flat = scene.swing

    def swing(length_m, time_s, links=150):
        hand, curve = flat(length_m, time_s, links)
        tilt = SWAY_RAD * np.sin(2 * np.pi * SWAY_HZ * np.atleast_1d(time_s))[:, None, None]
        depth_m = np.linspace(0, length_m, links + 1)[None, :, None] * np.sin(tilt)
        place_m = hand[:, None, :2] + (curve - hand[:, None, :2]) * np.cos(tilt)
        return hand, np.concatenate([place_m, depth_m], axis=-1)

    def to_pixels(points_m):
        return pixels(camera, points_m) if points_m.shape[-1] == 3 else metre_to_pixel(camera, points_m)

    with monkeypatch.context() as patch:
        patch.setattr(scene, "swing", swing)
        patch.setattr(scene, "to_pixels", to_pixels)
        _, curves_m = scene.film(folder / f"{name}.mkv", LENGTH_M, seed=seed)
        found = scene.track(folder / f"{name}.mkv", LENGTH_M, camera=camera)
    seen = observe(found, camera, "main", {7: MarkerShape(scene.MARKER_M, 0.0)})
    return StringView(name, seen.string, camera, clock(name)), curves_m


@pytest.mark.thorough
def test_two_tracked_videos_locate_the_string_in_space(monkeypatch, tmp_path):
    left, curves_m = tracked("left", camera_from(-0.35), monkeypatch, tmp_path, 3)
    right, _ = tracked("right", camera_from(0.35, 0.1), monkeypatch, tmp_path, 4)
    truth_m = even_points(curves_m, POINTS)
    assert np.abs(truth_m[..., 2]).max() > 0.13
    found = reconstruct_in_space([left, right], LENGTH_M)
    assert found.warnings == []
    track = found.track
    error_m = np.linalg.norm(track.points_m - truth_m[track.frame], axis=-1)
    assert np.isfinite(error_m).mean() > 0.92  # places that one view only bridged in time are left out
    assert np.nanmedian(error_m) < 0.7e-3
    sure = (track.flags & UNSURE) == 0
    assert sure.mean() > 0.3
    assert np.sqrt(np.nanmean(error_m[sure] ** 2)) < 1e-3
    assert np.sqrt(np.nanmean(error_m**2)) < 6e-3

    same = np.intersect1d(left.pixels.frame, right.pixels.frame)
    rays = []
    for view in (left, right):
        rows = np.searchsorted(view.pixels.frame, same)
        rays.append(rays_of(view.pixels.points_px[rows], view.pixels.covariance_px2[rows], view.camera))
    by_number_m = np.linalg.norm(triangulate(rays).points_m - truth_m[same], axis=-1)
    assert np.sqrt(np.nanmean(by_number_m**2)) > 15e-3
