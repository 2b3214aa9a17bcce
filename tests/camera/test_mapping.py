import cv2
import numpy as np
import pytest

from strandcast.camera.flat import flat_camera
from strandcast.camera.mapping import (
    leaves_picture,
    metre_per_pixel,
    metre_to_pixel,
    pixel_per_metre,
    pixel_to_metre,
)
from strandcast.records.camera import Camera, Lens


@pytest.fixture
def camera(lens: Lens, looking) -> Camera:
    rotation, shift = looking(0.15, -0.2, 0.05, (0.3, 0.2), 2.3)
    return Camera(
        lens=lens,
        rotation=rotation.tolist(),
        translation_m=shift.tolist(),
        plane_rms_px=0.0,
        plane_markers=[],
        string_offset_m=0.02,
        scale_m_per_px=0.002,
        source="given",
    )


def test_projection_is_opencvs(camera):
    xy_m = np.random.default_rng(1).uniform(-0.5, 0.5, (50, 2))
    world = np.column_stack([xy_m, np.full(50, 0.03)])
    theirs, _ = cv2.projectPoints(
        world,
        cv2.Rodrigues(np.array(camera.rotation))[0],
        np.array(camera.translation_m),
        np.array(camera.lens.matrix),
        np.array(camera.lens.distortion),
    )
    np.testing.assert_allclose(metre_to_pixel(camera, xy_m, 0.03), theirs.reshape(-1, 2), atol=1e-9)


@pytest.mark.parametrize("offset_m", [0.0, 0.02, -0.1])
def test_pixel_to_metre_and_back_over_the_whole_picture(camera, offset_m):
    u, v = np.meshgrid(np.linspace(0, 959, 25), np.linspace(0, 539, 15))
    pixels = np.stack([u, v], axis=-1)
    back = metre_to_pixel(camera, pixel_to_metre(camera, pixels, offset_m), offset_m)
    np.testing.assert_allclose(back, pixels, atol=1e-6)


def test_the_rational_model_is_opencvs_and_has_its_inverse(camera):
    wide = camera.model_copy(deep=True)
    wide.lens.distortion = [0.3, 0.05, 0.001, -0.002, 0.01, 0.7, 0.1, 0.02]
    xy_m = np.random.default_rng(1).uniform(-0.9, 0.9, (50, 2))
    theirs, _ = cv2.projectPoints(
        np.column_stack([xy_m, np.full(50, 0.03)]),
        cv2.Rodrigues(np.array(wide.rotation))[0],
        np.array(wide.translation_m),
        np.array(wide.lens.matrix),
        np.array(wide.lens.distortion),
    )
    np.testing.assert_allclose(metre_to_pixel(wide, xy_m, 0.03), theirs.reshape(-1, 2), atol=1e-9)
    np.testing.assert_allclose(pixel_to_metre(wide, theirs.reshape(-1, 2), 0.03), xy_m, atol=1e-9)


def test_missing_points_stay_missing_and_do_not_affect_others(camera):
    pixels = np.array([[100.0, 200.0], [np.nan, 3.0], [400.0, 100.0]])
    places = pixel_to_metre(camera, pixels)
    assert np.isnan(places[1]).all()
    np.testing.assert_array_equal(places[[0, 2]], pixel_to_metre(camera, pixels[[0, 2]]))
    assert np.isnan(metre_to_pixel(camera, np.array([[np.nan, 1.0]]))).all()


def test_a_closer_plane_appears_larger_by_the_ratio_of_distances(looking, lens):
    straight = lens.model_copy(update={"distortion": [0.0] * 5})
    rotation, shift = looking(0.0, 0.0, 0.0, (0.0, 0.0), 2.0)
    camera = Camera(
        lens=straight,
        rotation=rotation.tolist(),
        translation_m=shift.tolist(),
        plane_rms_px=0.0,
        plane_markers=[],
        string_offset_m=0.0,
        scale_m_per_px=0.002,
        source="given",
    )
    np.testing.assert_allclose(
        pixel_to_metre(camera, np.array([470.0 + 110.0, 280.0 - 109.0]), 0.02),
        (0.2 * 0.99, 0.2 * 0.99),
        rtol=1e-9,
    )
    scale = metre_per_pixel(camera, np.array([0.1, 0.1]))
    assert scale == pytest.approx(2.0 / np.sqrt(1100.0 * 1090.0), rel=1e-6)


def test_the_jacobian_predicts_a_neighbouring_pixel(camera):
    here, step = np.array([0.2, 0.1]), np.array([1e-4, -2e-4])
    moved = metre_to_pixel(camera, here + step, 0.02) - metre_to_pixel(camera, here, 0.02)
    np.testing.assert_allclose(pixel_per_metre(camera, here, 0.02) @ step, moved, atol=1e-4)


def test_flat_camera_is_a_plain_scale():
    camera = flat_camera(550, 310, 0.002, (250.0, -40.0))
    np.testing.assert_allclose(pixel_to_metre(camera, np.array([260.0, -20.0])), (0.02, -0.04), atol=1e-12)
    assert metre_per_pixel(camera, np.array([0.0, 0.0])) == pytest.approx(0.002)


def test_a_string_leaves_the_picture_where_its_next_point_would_be_outside(camera):
    edge = pixel_to_metre(camera, np.array([camera.lens.width_px - 20.0, 200.0]), camera.string_offset_m)
    inwards = pixel_to_metre(camera, np.array([camera.lens.width_px - 60.0, 200.0]), camera.string_offset_m)
    step = edge - inwards
    string = inwards + step * np.arange(-2, 4)[:, None]
    leaving, hidden, whole = string.copy(), string - 4.0 * step, string - 6.0 * step
    leaving[4:] = hidden[4:] = np.nan
    nothing = np.full_like(string, np.nan)
    np.testing.assert_array_equal(
        leaves_picture(camera, np.stack([whole, hidden, leaving, nothing, leaving])), [2, 4]
    )
