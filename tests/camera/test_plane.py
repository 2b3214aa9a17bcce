from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from strandcast.camera.mapping import metre_to_pixel, pixel_to_metre
from strandcast.camera.marker_pose import marker_pose
from strandcast.camera.markers import detect_markers, marker_detector
from strandcast.camera.plane import PlaneMarker, plane_from_markers
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera

DICTIONARY = "DICT_4X4_50"
MARKERS = [
    PlaneMarker(0, -0.6, 0.35, 0.08),
    PlaneMarker(1, 0.6, 0.35, 0.08, 0.4),
    PlaneMarker(2, 0.6, -0.3, 0.08, -1.0),
    PlaneMarker(3, -0.6, -0.3, 0.08),
    PlaneMarker(4, 0.05, 0.3, 0.08, 3.0),
]
POSE = (0.06, -0.1, 0.03, (0.0, 0.02), 1.9)


@pytest.fixture(scope="module")
def photo(photograph, paint_markers, looking, lens) -> np.ndarray:
    return photograph(*paint_markers(MARKERS, DICTIONARY), lens, *looking(*POSE))


@pytest.fixture
def truth(lens, looking) -> Camera:
    rotation, shift = looking(*POSE)
    return Camera(
        lens=lens,
        rotation=rotation.tolist(),
        translation_m=shift.tolist(),
        plane_rms_px=0.0,
        plane_markers=[],
        string_offset_m=0.0,
        scale_m_per_px=0.0,
        source="given",
    )


def test_the_plane_is_mapped_to_a_tenth_of_a_millimetre(photo, lens, truth):
    found = plane_from_markers(photo, lens, MARKERS, DICTIONARY)
    x, y = np.meshgrid(np.linspace(-0.6, 0.6, 9), np.linspace(-0.3, 0.35, 7))
    places = np.stack([x, y], axis=-1)
    for offset_m, allowed_m in ((0.0, 2e-4), (0.02, 3e-4)):
        back = pixel_to_metre(found, metre_to_pixel(truth, places, offset_m), offset_m)
        assert np.abs(back - places).max() < allowed_m
    assert found.plane_rms_px < 0.3
    assert sorted(fit.marker for fit in found.plane_markers) == [0, 1, 2, 3, 4]
    assert all(len(fit.residuals_px) == 4 for fit in found.plane_markers)
    assert found.scale_m_per_px == pytest.approx(1.9 / 1095, rel=0.02)
    assert -(np.array(found.rotation).T @ found.translation_m)[2] == pytest.approx(
        1.9, abs=0.02
    )  # world z: to us


def test_a_marker_that_is_not_seen_is_told(photo, lens):
    extra = PlaneMarker(17, 0.0, 0.0, 0.08)
    found = plane_from_markers(photo, lens, [*MARKERS, extra], DICTIONARY)
    assert found.warnings == ["markers [17] of the plane were not seen"]


def test_a_mirrored_picture_is_named(photo, lens):
    with pytest.raises(StrandcastError, match="mirrored"):
        plane_from_markers(np.ascontiguousarray(photo[:, ::-1]), lens, MARKERS, DICTIONARY)


def test_a_wrong_dictionary_is_named(photo, lens):
    with pytest.raises(StrandcastError, match="of DICT_4X4_1000 or a part of it, not of DICT_6X6_50"):
        plane_from_markers(photo, lens, MARKERS, "DICT_6X6_50")


def test_no_markers_and_other_markers_are_named(photo, lens):
    with pytest.raises(StrandcastError, match=r"needed \[0, 1, 2, 3, 4\], found \[\]"):
        plane_from_markers(np.full_like(photo, 128), lens, MARKERS, DICTIONARY)
    others = [dataclasses.replace(marker, marker=marker.marker + 20) for marker in MARKERS]
    with pytest.raises(StrandcastError, match=r"other ids seen: \[0, 1, 2, 3, 4\]"):
        plane_from_markers(photo, lens, others, DICTIONARY)
    with pytest.raises(StrandcastError, match="the plane has 1 markers"):
        plane_from_markers(photo, lens, MARKERS[:1], DICTIONARY)


def test_a_marker_that_is_there_twice_is_named(photograph, paint_markers, looking, lens):
    copy = PlaneMarker(3, 0.1, 0.0, 0.08)
    photo = photograph(*paint_markers([*MARKERS, copy], DICTIONARY), lens, *looking(*POSE))
    with pytest.raises(StrandcastError, match=r"\[3\] are in the picture twice"):
        plane_from_markers(photo, lens, MARKERS, DICTIONARY)


def test_a_marker_in_another_place_is_named_with_its_place(photo, lens):
    wrong = [*MARKERS[:2], dataclasses.replace(MARKERS[2], x_m=0.57), *MARKERS[3:]]
    with pytest.raises(
        StrandcastError, match=r"marker 2 lies at \(0\.(600|599|601)\d, -0\.(300|299|301)\d\) m.*30\.\d mm"
    ):
        plane_from_markers(photo, lens, wrong, DICTIONARY)


def test_a_wrong_size_is_named(photo, lens):
    wrong = [dataclasses.replace(marker, size_m=0.072) for marker in MARKERS]
    with pytest.raises(StrandcastError, match=r"measure (79|80)\.\d mm .* \+1[01]\.\d% from the size given"):
        plane_from_markers(photo, lens, wrong, DICTIONARY)


def test_a_picture_of_another_size_is_refused(photo, lens):
    with pytest.raises(StrandcastError, match="480 x 270 px, the lens was calibrated at 960 x 540"):
        plane_from_markers(cv2.resize(photo, (480, 270)), lens, MARKERS, DICTIONARY)


def test_twelve_bits_give_the_plane_of_eight(photo, lens):
    eight = plane_from_markers(photo, lens, MARKERS, DICTIONARY)
    twelve = plane_from_markers(photo.astype(np.uint16) * 16, lens, MARKERS, DICTIONARY)
    np.testing.assert_allclose(twelve.translation_m, eight.translation_m, atol=1e-3)


def test_place_and_turn_of_a_marker_before_the_plane(photograph, paint_markers, looking, lens, truth):
    hand = PlaneMarker(40, 0.21, -0.07, 0.05, 0.7)
    rotation, shift = looking(*POSE)
    nearer = shift + rotation @ np.array([0.0, 0.0, 0.02])  # the picture of the plane 20 mm in front
    photo = photograph(*paint_markers([hand], DICTIONARY), lens, rotation, nearer)
    ids, corners = detect_markers(photo, marker_detector(DICTIONARY))
    assert ids.tolist() == [40]
    pose, sigma_m = marker_pose(truth, corners, hand.size_m, 0.02)
    np.testing.assert_allclose(pose[0, :2], (0.21, -0.07), atol=2e-4)
    assert pose[0, 2] == pytest.approx(0.7, abs=5e-3)
    assert 1e-5 < sigma_m[0] < 5e-4
    behind, _ = marker_pose(truth, corners, hand.size_m, 0.0)
    assert np.linalg.norm(behind[0, :2] - pose[0, :2]) > 1e-3  # the offset matters
