"""Drawn strings of known course: centre, order through crossings, ends, and flagged ambiguities."""

import cv2
import numpy as np
import pytest

from strandcast.errors import StrandcastError
from strandcast_studies.stills.centreline import string_in_mask, string_in_picture
from strandcast_studies.stills.line import even_line, smooth
from strandcast_studies.stills.mask import largest_part
from strandcast_studies.stills.order import HEADING_SIGMA_RAD, BranchArm, link_cost

SHAPE = (420, 640)
CROSSING = np.array([200.0, 210.3])
FINER = 4  # oversampling of the drawing


def drawn(course: np.ndarray, width: float, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    """Return the coverage (h, w), 0 … 1, of a string along a course (N, 2) [px]."""
    fine = np.zeros((FINER * shape[0], FINER * shape[1]), np.uint8)
    places = np.rint(((course + 0.5) * FINER - 0.5) * 16).astype(np.int32)
    cv2.polylines(fine, [places], False, 255, round(FINER * width), cv2.LINE_8, 4)
    return cv2.resize(fine, shape[::-1], interpolation=cv2.INTER_AREA) / 255.0


def across(found: np.ndarray, course: np.ndarray) -> np.ndarray:
    """Return the distances (K,) of found points from the course as a polyline."""
    nearest = np.linalg.norm(found[:, None] - course[None, 1:-1], axis=2).argmin(axis=1) + 1
    along = course[nearest + 1] - course[nearest - 1]
    off = found - course[nearest]
    return np.abs(along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0]) / np.linalg.norm(along, axis=1)


def apart(found: np.ndarray, course: np.ndarray) -> float:
    """Return the largest distance between equal shares of two lines, in the better direction."""
    shares = [
        np.column_stack(
            [np.interp(np.linspace(0, 1, 300), np.linspace(0, 1, len(e)), e[:, c]) for c in (0, 1)]
        )
        for e in (even_line(found)[0], even_line(course)[0])
    ]
    return min(np.linalg.norm(shares[0][::step] - shares[1], axis=1).max() for step in (1, -1))


def loop(angle_rad: float = 1.6) -> np.ndarray:
    """Return two straight legs that cross at CROSSING at an angle, joined by a smooth arc."""
    half = 0.5 * angle_rad
    radius = min(60.0, 250.0 * np.sin(half))
    turn = np.linspace(np.pi / 2 + half, -np.pi / 2 - half, 400)
    arc = [radius / np.sin(half), 0.0] + radius * np.column_stack([np.cos(turn), np.sin(turn)])
    far = np.linspace(-150.0, radius / np.tan(half), 500)[:, None]
    coming, going = far * [np.cos(half), np.sin(half)], far[::-1] * [np.cos(half), -np.sin(half)]
    return CROSSING + even_line(np.vstack([coming, arc[1:-1], going]), 0.5)[0]


def random_string(seed: int, width: float, length: int) -> np.ndarray:
    """Return a smooth course that fits into the picture and usually crosses itself."""
    rng = np.random.default_rng(seed)
    while True:
        nodes = rng.normal(0.0, 1.0, length // 60 + 4) * rng.uniform(0.006, 0.018)
        curvature = np.interp(np.arange(length), 60.0 * np.arange(len(nodes)), nodes)
        heading = np.cumsum(np.clip(curvature, -1 / (3 * width), 1 / (3 * width))) + rng.uniform(0, 6.3)
        course = np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
        room = np.array(SHAPE[::-1]) - np.ptp(course, axis=0)
        if (room > 4 * width).all():
            return course - course.min(axis=0) + room / 2


def test_a_loop_is_ordered_and_measured():
    course = loop()
    string = string_in_mask(drawn(course, 7.0) > 0.5)
    assert apart(string.line_px, course) < 5.0  # drawn ends are round: half a width longer
    assert np.median(across(string.line_px[string.measured], course)) < 0.12
    inside = np.linalg.norm(string.line_px - CROSSING, axis=1) < 15.0
    assert across(string.line_px[inside], course).max() < 0.6
    assert string.width_px == pytest.approx(7.0, abs=0.3)
    assert string.length_px == pytest.approx(np.linalg.norm(np.diff(course, axis=0), axis=1).sum(), abs=8.0)
    (crossing,) = string.crossings
    assert crossing.sure
    assert crossing.crosses
    np.testing.assert_allclose(crossing.place_px, CROSSING, atol=3.0)
    first, last = crossing.along_px
    np.testing.assert_allclose(string.line_px[[int(first), int(last)]], [CROSSING] * 2, atol=3.0)
    assert not string.measured[int(first)]  # two strands are one blob there


@pytest.mark.parametrize("angle_rad", [2.4, 1.0, 0.5, 0.3])
def test_steep_and_flat_crossings(angle_rad):
    course = loop(angle_rad)
    string = string_in_mask(drawn(course, 7.0) > 0.5)
    assert apart(string.line_px, course) < 6.0
    assert len(string.crossings) == 1
    # The strands are not pulled to the middle of their common blob.
    inside = np.linalg.norm(string.line_px - CROSSING, axis=1) < 40.0
    assert across(string.line_px[inside], course).max() < 1.0


@pytest.mark.parametrize(("string_grey", "wall_grey"), [(40.0, 170.0), (200.0, 90.0)])
def test_polarity_and_threshold_are_found(string_grey, wall_grey):
    course = loop()
    cover = drawn(course, 6.0)
    rows = np.linspace(-25.0, 25.0, SHAPE[0])[:, None]
    noise = np.random.default_rng(3).normal(0.0, 3.0, SHAPE)
    picture = np.clip(wall_grey + rows + cover * (string_grey - wall_grey) + noise, 0, 255).astype(np.uint8)
    string = string_in_picture(picture)
    assert string.choices["polarity"] == np.sign(string_grey - wall_grey)
    assert apart(string.line_px, course) < 4.0
    assert np.median(across(string.line_px[string.measured], course)) < 0.12


def test_a_thin_string_in_noise_is_found_whole():
    """Two pixels wide, blurred, contrast 40 grey levels in noise of 5."""
    for seed in range(4):
        course = random_string(seed + 50, 6.0, 700)
        cover = cv2.GaussianBlur(drawn(course, 2.0), (0, 0), 0.7)
        noise = np.random.default_rng(seed).normal(0.0, 5.0, SHAPE)
        string = string_in_picture(np.clip(150.0 - 40.0 * cover + noise, 0, 255).astype(np.uint8))
        assert apart(string.line_px, course) < 8.0
        assert np.median(across(string.line_px[string.measured], course)) < 0.1


def test_a_string_in_pieces_is_flagged():
    mask = drawn(np.array([[50.0, 100.0], [400.0, 200.0]]), 7.0) > 0.5
    assert string_in_mask(mask).sure
    mask[:, 300:310] = False
    assert not string_in_mask(mask).sure


def pictured(cover: np.ndarray) -> np.ndarray:
    noise = np.random.default_rng(3).normal(0.0, 2.0, cover.shape)
    return np.clip(60.0 + 120.0 * cover + noise, 0, 255).astype(np.uint8)


def test_a_whole_string_raises_no_doubt():
    string = string_in_picture(pictured(drawn(loop(), 7.0)))
    assert string.doubts == []
    assert string.sure


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ("faded", "something continues beyond"),
        ("gap", "something continues beyond"),
        ("border", "touches the picture's border"),
        ("smudge", "leaves a part of it out"),
    ],
)
def test_an_end_a_gap_or_a_border_raises_a_doubt(damage, words):
    course = loop()
    cover = drawn(course, 7.0)
    apart_px = np.linalg.norm(np.indices(SHAPE)[::-1] - course[0][:, None, None], axis=0)
    if damage == "faded":
        cover[apart_px < 60.0] *= 0.12
    elif damage == "gap":
        cover[(apart_px > 40.0) & (apart_px < 52.0)] = 0.0
    elif damage == "border":
        cover = cover[:, int(course[0, 0]) + 20 :]
    else:
        cv2.circle(cover, tuple(np.rint(course[120]).astype(int).tolist()), 24, 1.0, -1)
    string = string_in_picture(pictured(np.ascontiguousarray(cover)))
    assert any(words in doubt for doubt in string.doubts), string.doubts
    assert not string.sure


def test_a_blob_is_no_string():
    blob = cv2.ellipse(np.zeros(SHAPE), (300, 200), (30, 19), 30, 0, 360, 1.0, -1)
    string = string_in_picture(pictured(blob))
    assert "it is too short for its width" in string.doubts


def test_a_given_background_removes_other_objects():
    course = loop()
    wall = np.full(SHAPE, 150.0)
    wall[:, 500:560] = 30.0  # darker and larger than the string
    picture = np.where(drawn(course, 6.0) > 0.5, 60.0, wall)
    string = string_in_picture(picture.astype(np.uint8), wall.astype(np.uint8))
    assert apart(string.line_px, course) < 4.0


def test_the_start_is_where_the_hand_is():
    course = loop()
    mask = drawn(course, 7.0) > 0.5
    for end in (course[0], course[-1]):
        line = string_in_mask(mask, end).line_px
        np.testing.assert_allclose(line[0], end, atol=5.0)


def test_touching_strands_are_flagged():
    """Two strands overlap for 60 px: whether they change sides is not visible."""
    x = np.linspace(60.0, 420.0, 721)
    bow = 70.0 * np.clip(np.abs(x - 240.0) / 180.0 - 0.17, 0.0, None) ** 1.5
    upper, lower = np.column_stack([x, 200.0 - bow]), np.column_stack([x, 200.0 + bow])
    turn = np.linspace(-np.pi / 2, np.pi / 2, 300)
    height = 0.5 * (lower[-1, 1] - upper[-1, 1])
    cap = np.column_stack([420.0 + height * np.cos(turn), 200.0 + height * np.sin(turn)])
    string = string_in_mask(drawn(np.vstack([upper, cap, lower[::-1]]), 6.0) > 0.5)
    assert not string.sure


def test_an_end_on_the_string_is_found_and_flagged():
    course = loop()
    late = len(course) // 2
    second = late + int(np.linalg.norm(course[late:] - CROSSING, axis=1).argmin())
    string = string_in_mask(drawn(course[: second + 1], 7.0) > 0.5)
    assert [c.sure for c in string.crossings] == [False]
    assert min(np.linalg.norm(string.line_px[[0, -1]] - course[second], axis=1)) < 12.0


def test_a_silhouette_that_is_not_one_string_is_refused():
    fork = np.maximum(
        drawn(np.array([[100.0, 200.0], [300.0, 200.0], [450.0, 120.0]]), 7.0),
        drawn(np.array([[300.0, 200.0], [450.0, 300.0]]), 7.0),
    )
    ring = drawn(
        np.array([[100.0, 100.0], [300.0, 100.0], [300.0, 300.0], [100.0, 300.0], [100.0, 100.0]]), 7.0
    )
    for mask, code in ((fork, "SC-T021"), (ring, "SC-T021"), (np.zeros(SHAPE), "SC-T020")):
        with pytest.raises(StrandcastError) as caught:
            string_in_mask(mask > 0.5)
        assert caught.value.code == code


def test_random_strings_are_ordered_or_flagged():
    right, doubted, wrong = 0, 0, []
    for seed in range(24):
        course = random_string(seed, 6.0, 1500)
        string = string_in_mask(drawn(course, 6.0) > 0.5)
        good = apart(string.line_px, course) < 16.0
        right += good
        doubted += not string.sure
        if not good and string.sure:
            wrong.append(seed)
    assert wrong == []
    assert right >= 21
    assert doubted <= 8


def test_the_cost_of_a_link_is_its_squared_turn():
    """An arc that turns by 1 rad costs 1 rad² over the usual; an S-bend of the same slopes three times it."""
    here = BranchArm(np.zeros(2), np.array([-np.cos(0.5), np.sin(0.5)]), 0)
    arc = BranchArm(np.array([100.0, 0.0]), np.array([np.cos(0.5), np.sin(0.5)]), 0)
    bend = BranchArm(np.array([100.0, 0.0]), np.array([np.cos(0.5), -np.sin(0.5)]), 0)
    usual = HEADING_SIGMA_RAD**2 + 0.002**2 * 100.0**2
    assert link_cost(here, arc, 0.002) == pytest.approx(1.0 / usual)
    assert link_cost(here, bend, 0.002) == pytest.approx(3.0 / usual)


def test_a_pinhole_is_filled_and_a_loop_is_not():
    mask = drawn(loop(), 9.0) > 0.5
    pierced = mask.copy()
    inner = cv2.erode(mask.astype(np.uint8), np.ones((7, 7)))
    row, column = np.argwhere(inner)[0]
    pierced[row, column] = False
    filled, _ = largest_part(pierced)
    np.testing.assert_array_equal(filled, mask)


def test_without_weight_a_line_is_an_unloaded_beam():
    x = np.arange(200.0)
    line = np.column_stack([x, 0.002 * (x - 100.0) ** 2])
    weight = np.ones(200)
    weight[80:120] = 0.0
    disturbed = line.copy()
    disturbed[80:120, 1] += 30.0
    np.testing.assert_allclose(smooth(disturbed, weight, 2.0), line, atol=0.15)
