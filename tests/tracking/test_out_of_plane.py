"""A string that sways out of the plane is warned of with its cost, one that does not is not."""

import numpy as np
import pytest

from strandcast.tracking.chain.out_of_plane import ApparentStrings, least_tilt_rad, measure_out_of_plane

SWAY_HZ = 3.0


def swayed(scene, monkeypatch, largest_rad):
    """Let the scene's string sway about the hand: it looks as the camera projects it onto the plane."""
    flat, height_m = scene.swing, scene.flat_camera().translation_m[2]

    def swing(length_m, time_s, links=150):
        hand, curve = flat(length_m, time_s, links)
        tilt = largest_rad * np.sin(2 * np.pi * SWAY_HZ * np.atleast_1d(time_s))[:, None, None]
        depth_m = np.linspace(0, length_m, links + 1)[None, :, None] * np.sin(tilt)
        place_m = hand[:, None, :2] + (curve - hand[:, None, :2]) * np.cos(tilt)
        return hand, place_m * height_m / (height_m - depth_m)

    monkeypatch.setattr(scene, "swing", swing)


@pytest.mark.parametrize(
    "largest_rad", [*(pytest.param(x, marks=pytest.mark.thorough) for x in (0.0, 0.1)), 0.2]
)
def test_sway_is_warned_of_with_its_cost(scene, monkeypatch, tmp_path, largest_rad):
    swayed(scene, monkeypatch, largest_rad)
    scene.film(tmp_path / "sway.mkv")
    warnings = [text for text in scene.track(tmp_path / "sway.mkv").warnings if "plane of motion" in text]
    if largest_rad == 0.0:
        assert warnings == []
        return
    [warning] = warnings
    depth_mm = float(warning.split("plane of motion by ")[1].split(" mm")[0])
    assert 0.55 < depth_mm / (300 * np.sin(largest_rad)) <= 1.0


def tilted(scene, tilt_rad, length_m=0.3):
    """Strings along an arc that are tilted about the hand, as a camera sees them."""
    heading = np.linspace(-1.6, -0.6, 30)
    step_m = length_m / 30 * np.column_stack([np.cos(heading), np.sin(heading)])
    curve = np.concatenate([np.zeros((1, 2)), np.cumsum(step_m, axis=0)])
    depth_m = np.linspace(0, length_m, 31)[None, :, None] * np.sin(tilt_rad)[:, None, None]
    height_m = scene.flat_camera().translation_m[2]
    hand_m = np.array([0.1, 0.2])
    place_m = hand_m + curve * np.cos(tilt_rad)[:, None, None]
    return place_m * height_m / (height_m - depth_m)


def test_the_least_tilt_explains_the_apparent_length(scene):
    true_rad = np.array([-0.5, -0.3, -0.1, 0.0, 0.03])
    nodes_m = tilted(scene, true_rad)
    change_m = np.linalg.norm(np.diff(nodes_m, axis=1), axis=2).sum(axis=1) - 0.3
    found_rad = least_tilt_rad(nodes_m, change_m, 0.3, np.zeros(2), scene.flat_camera().translation_m[2])
    assert (np.abs(found_rad) <= np.abs(true_rad) + 1e-3).all()
    assert np.abs(found_rad) == pytest.approx(np.abs(true_rad), abs=0.02)


def test_a_clamp_in_another_place_and_a_slip_are_no_sway(scene):
    nodes_m = tilted(scene, np.zeros(60))
    direction_rad = np.linspace(-2.0, 2.0, 60)
    path_m = 0.3 + 0.004 * np.cos(direction_rad)
    strings = ApparentStrings(nodes_m, path_m, direction_rad)
    assert measure_out_of_plane(strings, 0.3, scene.flat_camera()).length_range_m < 1e-6
    shaken = strings._replace(path_m=path_m + 0.004 * np.tile([-1, 1], 30))
    assert measure_out_of_plane(shaken, 0.3, scene.flat_camera(), 6e-3).length_range_m > 6e-3
    assert measure_out_of_plane(shaken, 0.3, scene.flat_camera(), 9e-3) is None
    folded = strings._replace(path_m=0.3 - 0.05 * (direction_rad < -1.8))  # in three frames of sixty
    assert measure_out_of_plane(folded, 0.3, scene.flat_camera()).length_range_m < 1e-6
    slipped = strings._replace(path_m=0.3 + np.repeat([0.0, 0.02], 30))
    assert measure_out_of_plane(slipped, 0.3, scene.flat_camera()) is None
    few = ApparentStrings(nodes_m[:19], path_m[:19], direction_rad[:19])
    assert measure_out_of_plane(few, 0.3, scene.flat_camera()) is None
