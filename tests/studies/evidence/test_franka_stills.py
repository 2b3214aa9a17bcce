"""A cable's length from one calibrated picture: a drawn one, and two real ones."""

import cv2
import numpy as np
import pytest

from strandcast.errors import StrandcastError
from strandcast_studies.evidence import franka_stills as stills

CAMERA = np.array([[1400.0, 0.0, 960.0], [0.0, 1400.0, 540.0], [0.0, 0.0, 1.0]])
LOOK = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # along y, z up
EYE = np.array([0.0, -1.4, 0.5])
FLANGE = np.array([0.02, -0.2, 0.78])
COLOURS = {"red": (40, 40, 190), "yellow": (30, 200, 210), "blue": (200, 150, 40)}


def drawn_view(radius_m: float = 0.9) -> stills.CalibratedPicture:
    """A cable of 0.40 m from band to band on a circle of a radius, hung 30 mm below the flange.

    Near its end it is in a dark sleeve that is wider than the cable and not in line with it.
    """
    projection = CAMERA @ np.column_stack([LOOK, -LOOK @ EYE])
    pose = np.eye(4)
    pose[:3, 3] = FLANGE
    view = stills.CalibratedPicture(np.full((1080, 1920, 3), 180, np.uint8), projection, pose)
    turn = np.linspace(-0.01, 0.41, 200) / radius_m
    x, z = FLANGE[0] - radius_m * (1 - np.cos(turn)), FLANGE[2] - 0.03 - radius_m * np.sin(turn)
    course = np.array([view.project(np.array([a, FLANGE[1], b])) for a, b in zip(x, z, strict=True)])
    cv2.polylines(
        view.picture, [np.rint(course * 16).astype(np.int32)], False, (35, 35, 35), 21, cv2.LINE_AA, 4
    )
    sleeve = np.rint((course[-25:-5] + np.array([6.0, 0.0])) * 16).astype(np.int32)
    cv2.polylines(view.picture, [sleeve], False, (35, 35, 35), 36, cv2.LINE_AA, 4)
    for colour, share in (("red", 0.0), ("yellow", 0.5), ("blue", 1.0)):
        k = int((0.01 + 0.40 * share) / 0.42 * 199)
        ends = np.rint(course[[k - 3, k + 4]] * 16).astype(np.int32)
        cv2.polylines(view.picture, [ends], False, COLOURS[colour], 19, cv2.LINE_AA, 4)
    return view


def test_the_length_of_a_drawn_cable_is_measured():
    view = drawn_view()
    cable = stills.find_cable(view)
    facing = np.array([0.0, 1.0, 0.0])
    places = stills.on_plane(view, cable.line_px, FLANGE, facing)
    np.testing.assert_allclose(places[:, 1], FLANGE[1], atol=1e-9)
    assert stills.length_m(places) == pytest.approx(0.40, rel=0.01)
    assert cable.measured.mean() > 0.8
    np.testing.assert_allclose(
        cable.line_px[[0, -1]], [cable.bands_px["red"], cable.bands_px["blue"]], atol=1.0
    )
    # The sleeve does not shift the line: it stays on its circle.
    turn = np.linspace(0.0, 0.40, 50) / 0.9
    circle = np.column_stack([FLANGE[0] - 0.9 * (1 - np.cos(turn)), FLANGE[2] - 0.03 - 0.9 * np.sin(turn)])
    course = [view.project(np.array([x, FLANGE[1], z])) for x, z in circle]
    apart = np.linalg.norm(np.array(course)[:, None] - cable.line_px[None], axis=2).min(axis=1)
    assert apart.max() < 1.5
    # A plane 10 mm nearer to the eye, which is 1.2 m away, shows all things smaller by as much.
    nearer = stills.on_plane(view, cable.line_px, FLANGE - 0.01 * facing, facing)
    assert stills.length_m(nearer) / stills.length_m(places) == pytest.approx(1.0 - 0.01 / 1.2, abs=1e-6)


def test_the_error_names_the_missing_band():
    view = drawn_view()
    view.picture[view.picture[..., 0] > 190] = 180  # no blue
    with pytest.raises(StrandcastError, match="blue") as caught:
        stills.find_cable(view)
    assert caught.value.code == "SC-T020"


def test_the_length_of_the_real_cable_is_measured(real_data):
    figures = stills.measure(real_data / "franka_cable_stills")
    assert len(figures) == 2
    for figure in figures:
        assert figure.met, figure
        assert figure.detail["measured_share"] > 0.6
        assert -1.1 < figure.detail["percent_per_10_mm_of_plane"] < -0.8
