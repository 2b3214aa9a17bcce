"""The picture of the calibration shows everything where the camera projects it."""

import cv2
import matplotlib as mpl
import numpy as np
import pytest

from strandcast.camera.flat import flat_camera
from strandcast.camera.mapping import metre_to_pixel
from strandcast.camera.picture import ARROW, ERROR, GRID, MARKER, WIDTH_PX, camera_picture
from strandcast.camera.plane import plane_from_markers
from strandcast.camera.pose import PlacedMarker
from strandcast.records.camera import Camera

MARKERS = [
    PlacedMarker(0, -0.6, 0.35, 0.08),
    PlacedMarker(1, 0.6, 0.35, 0.08, 0.4),
    PlacedMarker(2, 0.6, -0.3, 0.08, -1.0),
    PlacedMarker(3, -0.6, -0.3, 0.08),
]


@pytest.fixture(scope="module")
def photo(photograph, paint_markers, looking, lens) -> np.ndarray:
    return photograph(
        *paint_markers(MARKERS, "DICT_4X4_50"), lens, *looking(0.06, -0.1, 0.03, (0.0, 0.02), 1.9)
    )


@pytest.fixture(scope="module")
def camera(photo, lens) -> Camera:
    return plane_from_markers(
        *(photo, lens, MARKERS, "DICT_4X4_50"),
        string_offset_m=0.02,
        string_offset_sd_m=1e-3,
        workspace_m=((-0.55, 0.55), (-0.25, 0.3)),
    )


def near(picture: np.ndarray, place_px: np.ndarray, colour: str, reach: int = 2) -> bool:
    """Return whether a colour is drawn at a position (u, v)."""
    u, v = np.rint(place_px).astype(int)
    window = picture[max(v - reach, 0) : v + reach + 1, max(u - reach, 0) : u + reach + 1].astype(float)
    return bool(np.abs(window - 255.0 * np.array(mpl.colors.to_rgb(colour))).sum(axis=-1).min() < 120)


def test_grid_markers_and_errors_are_at_the_projected_positions(photo, camera, lens):
    picture = camera_picture(photo, camera)
    zoom = WIDTH_PX / lens.width_px
    assert picture.shape[1] == WIDTH_PX
    assert picture.dtype == np.uint8
    on_grid = metre_to_pixel(camera, np.array([[0.0, 0.17], [-0.4, 0.13], [0.33, 0.2], [0.13, -0.2]]), 0.02)
    beside = metre_to_pixel(
        camera, np.array([[0.05, 0.17], [-0.45, 0.13], [0.33, 0.25], [0.13, -0.15]]), 0.02
    )
    assert all(near(picture, zoom * (place + 0.5), GRID) for place in on_grid)
    assert not any(near(picture, zoom * (place + 0.5), GRID) for place in beside)
    for fit in camera.plane_markers:
        corners = np.array(fit.residuals_px)[:, :2]
        sides = 0.5 * (corners + np.roll(corners, -1, axis=0))
        assert sum(near(picture, zoom * (side + 0.5), MARKER) for side in sides) >= 3
    x, y = camera.plane_error.x_m[4], camera.plane_error.y_m[3]
    assert near(picture, zoom * (metre_to_pixel(camera, np.array([x, y]), 0.02) + 0.5), ERROR)


def test_arrows_grow_with_the_residuals(photo, camera, lens):
    off = camera.model_copy(deep=True)
    corner = np.array(off.plane_markers[1].residuals_px[0][:2])
    for fit in off.plane_markers:
        fit.residuals_px = [[*row[:2], 0.0, 0.0] for row in fit.residuals_px]
    off.plane_markers[1].residuals_px[0][2:] = [-5.0, 0.0]  # rms 1.25 px: drawn × 10 or so
    picture = camera_picture(photo, off)
    zoom = WIDTH_PX / lens.width_px
    assert near(picture, zoom * (corner + (-45.0, 0.0) + 0.5), ARROW)
    assert not near(picture, zoom * (corner + (-140.0, 0.0) + 0.5), ARROW)


def test_a_pendulums_camera_and_twelve_bits_are_drawn_too():
    grey = np.full((310, 550), 2000, np.uint16)
    cv2.circle(grey, (250, 200), 12, 4095, -1)
    picture = camera_picture(grey, flat_camera(550, 310, 0.002, (250.0, 40.0), source="arc"))
    zoom = WIDTH_PX / 550
    assert near(picture, zoom * (np.array([250.0, 140.0]) + 0.5), GRID)  # x = 0
    assert picture[round(zoom * 200), round(zoom * 255)].min() > 150  # the ball


def test_the_same_bytes_each_time(photo, camera):
    np.testing.assert_array_equal(camera_picture(photo, camera), camera_picture(photo, camera))
