"""The plane in which a marker of known size moves, from its apparent size."""

import numpy as np
import pytest

from strandcast.camera.mapping import pixel_to_metre
from strandcast.camera.markers import corners_of
from strandcast.camera.pose import project
from strandcast.camera.tilt import check_plane_tilt, fit_plane_tilt
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera

SIZE_M, OFFSET_M = 0.05, 0.01


@pytest.fixture
def camera(lens, looking) -> Camera:
    rotation, shift = looking(0.06, -0.1, 0.03, (0.0, 0.02), 1.9)
    return Camera(
        lens=lens,
        rotation=rotation.tolist(),
        translation_m=shift.tolist(),
        plane_rms_px=0.0,
        plane_markers=[],
        string_offset_m=0.0,
        scale_m_per_px=1.9 / 1095,
        source="given",
    )


def swing(
    camera: Camera, height_m: float, slope_x: float, slope_y: float, seed: int, frames: int = 400
) -> np.ndarray:
    """Return the corners (F, 4, 2) of a marker swung about in a plane; some frames lost."""
    random = np.random.default_rng(seed)
    phase = np.linspace(0, 5, frames)
    place = np.column_stack([0.4 * np.sin(phase), 0.2 * np.sin(1.7 * phase)])
    # The plane's own axes, so that the marker keeps its size in it.
    along_x = np.array([1.0, 0.0, slope_x]) / np.hypot(1.0, slope_x)
    along_y = np.array([0.0, 1.0, slope_y]) - slope_x * slope_y / (1 + slope_x**2) * np.array(
        [1.0, 0.0, slope_x]
    )
    along_y /= np.linalg.norm(along_y)
    angle = 0.5 * np.cos(phase)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]).transpose(2, 0, 1)
    own = corners_of(SIZE_M) @ turn + place[:, None]
    world = own[..., :1] * along_x + own[..., 1:] * along_y + np.array([0.0, 0.0, OFFSET_M + height_m])
    pixels = project(world, np.array(camera.rotation), np.array(camera.translation_m), camera.lens)
    pixels += random.normal(0, 0.1, pixels.shape)
    pixels[::17] = np.nan
    return pixels


def test_motion_in_the_declared_plane_gives_no_warning(camera):
    off = []
    for seed in range(20):
        tilt = fit_plane_tilt(camera, swing(camera, 0.0, 0.0, 0.0, seed), SIZE_M, OFFSET_M)
        off.append(tilt.plane / tilt.sigma)
        assert check_plane_tilt(tilt) == []
    assert np.sqrt(np.mean(np.square(off))) < 1.0  # the sigma allows for frames that err alike


@pytest.mark.parametrize(
    ("height_m", "slope_x", "slope_y"), [(0.0, 0.0875, 0.0), (0.0, 0.0, -0.0875), (0.03, 0.03, 0.02)]
)
def test_a_tilt_is_measured_and_reported_with_its_error(camera, height_m, slope_x, slope_y):
    corners = swing(camera, height_m, slope_x, slope_y, 1)
    tilt = fit_plane_tilt(camera, corners, SIZE_M, OFFSET_M)
    middle = np.nanmean(pixel_to_metre(camera, corners, OFFSET_M), axis=(0, 1))
    assert tilt.plane[1] == pytest.approx(slope_x, abs=0.012)
    assert tilt.plane[2] == pytest.approx(slope_y, abs=0.02)
    assert tilt.plane[0] == pytest.approx(height_m + middle @ (slope_x, slope_y), abs=2e-3)
    assert tilt.significance > 10
    warnings = check_plane_tilt(tilt) if tilt.cost_m <= 0.01 else None
    if warnings is None:
        with pytest.raises(StrandcastError, match=r"the hand moves in a plane .* degrees along x") as caught:
            check_plane_tilt(tilt, "video.mp4")
        assert caught.value.code == "SC-C041"
        assert float(caught.value.cost.split()[2]) == pytest.approx(tilt.cost_m * 1e3, abs=1.0)
    else:
        assert "at the string" in warnings[0]


def test_the_error_of_five_degrees(camera):
    """At 0.4 m they are 35 mm of height, which causes parallax, and 1.5 mm from the cosine."""
    slope = np.tan(np.radians(5))
    tilt = fit_plane_tilt(camera, swing(camera, 0.0, slope, 0.0, 3), SIZE_M, OFFSET_M)
    eye = -np.array(camera.rotation).T @ camera.translation_m
    parallax_m = 0.4 * slope * (0.4 + abs(eye[0])) / eye[2]
    assert tilt.cost_m == pytest.approx(parallax_m + 0.4 * (1 / np.cos(np.radians(5)) - 1), rel=0.1)


def test_too_few_detections_give_no_result(camera):
    assert fit_plane_tilt(camera, swing(camera, 0, 0, 0, 0, frames=15), SIZE_M, OFFSET_M) is None
