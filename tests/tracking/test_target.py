"""The target is located where it is and only there, and the tip's contact with it is detected."""

import cv2
import numpy as np
import pytest

from strandcast.records.camera import MarkerFit
from strandcast.tracking.background import Samples
from strandcast.tracking.events.contact import TipPath, detect_contact, find_contact, target_changed
from strandcast.tracking.events.target import locate_target, target_warnings

TARGET_M = np.array([0.081, -0.0476])
FINE = 8


def wall(scene, seed=0, edges=True):
    rng = np.random.default_rng(seed)
    rough = cv2.GaussianBlur(rng.normal(0, 1, (scene.HEIGHT, scene.WIDTH)), (0, 0), 5)
    picture = (120 + 10 * rough / rough.std()).astype(np.float32)
    if edges:
        for x in range(20, scene.WIDTH, 90):
            picture[:, x : x + 3] -= 35
        for _ in range(10):
            u, v, w, h = rng.uniform(0, 500, 4)
            cv2.rectangle(picture, (int(u), int(v)), (int(u + w), int(v + h)), float(rng.uniform(60, 190)), 2)
    return cv2.GaussianBlur(picture, (0, 0), 0.8)


def disc(scene, picture, place_m, radius_m, level):
    """Paint a disc, anti-aliased; sixteenths of a pixel are OpenCV's grain."""
    spot = np.rint(scene.to_pixels(np.asarray(place_m)) * 16).astype(int).tolist()
    cv2.circle(picture, spot, round(radius_m / scene.SCALE_M * 16), level, -1, cv2.LINE_AA, 4)


def sensed(picture):
    noisy = cv2.GaussianBlur(picture, (0, 0), 0.7) + np.random.default_rng(9).normal(0, 0.6, picture.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("radius_m", "level"), [(0.010, 30), (0.006, 230), (0.025, 60)])
@pytest.mark.parametrize("off_m", [(0.0, 0.0), (0.009, -0.012)])
def test_a_disc_is_located_to_a_fraction_of_a_pixel(scene, radius_m, level, off_m):
    picture = wall(scene)
    disc(scene, picture, TARGET_M + off_m, radius_m, level)
    seen = locate_target(sensed(picture), scene.flat_camera(), TARGET_M)
    assert np.hypot(*(np.array(seen.offset_m) - off_m)) < 0.3 * scene.SCALE_M
    assert seen.radius_m == pytest.approx(radius_m, rel=0.12)
    assert (seen.kind, bool(target_warnings(seen))) == ("round", off_m != (0.0, 0.0))


def test_a_rim_belongs_to_the_target(scene):
    picture = wall(scene, edges=False)
    disc(scene, picture, TARGET_M, 0.018, 40)
    disc(scene, picture, TARGET_M, 0.010, 220)
    assert locate_target(sensed(picture), scene.flat_camera(), TARGET_M).radius_m == pytest.approx(
        0.018, rel=0.15
    )


def test_a_square_sticker_and_a_marker_are_targets_too(scene):
    place = scene.to_pixels(TARGET_M + np.array([0.004, 0.0]))
    picture = wall(scene, edges=False)
    corners = place + 8.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    cv2.fillConvexPoly(picture, np.rint(corners * 16).astype(int), 230, cv2.LINE_AA, 4)
    seen = locate_target(sensed(picture), scene.flat_camera(), TARGET_M)
    assert np.allclose(seen.offset_m, [0.004, 0.0], atol=0.0006)
    picture = wall(scene, edges=False)
    scene.draw_marker(picture, place + 14.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), 23)
    seen = locate_target(sensed(picture), scene.flat_camera(), TARGET_M)
    assert seen.kind == "marker"
    assert np.allclose(seen.offset_m, [0.004, 0.0], atol=0.0006)


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_located_where_there_is_no_target(scene, seed):
    picture, camera = sensed(wall(scene, seed)), scene.flat_camera()
    places = np.random.default_rng(seed).uniform([-0.55, -0.4], [0.55, 0.4], (40, 2))
    assert [place for place in places if locate_target(picture, camera, place) is not None] == []


def test_two_discs_a_marker_of_the_plane_and_places_outside_are_not_located(scene):
    picture, camera = wall(scene, edges=False), scene.flat_camera()
    for side in (-1, 1):
        disc(scene, picture, TARGET_M + np.array([side * 0.018, 0.0]), 0.008, 220)
    assert locate_target(sensed(picture), camera, TARGET_M) is None
    assert locate_target(sensed(picture), camera, np.array([3.0, 0.0])) is None
    picture = wall(scene, edges=False)
    corners = scene.to_pixels(TARGET_M) + 14.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    scene.draw_marker(picture, corners, 3)
    residuals = [[u, v, 0.0, 0.0] for u, v in corners]
    known = MarkerFit(marker=3, rms_px=0.1, residuals_px=residuals)
    assert locate_target(sensed(picture), camera, TARGET_M) is not None
    assert (
        locate_target(sensed(picture), camera.model_copy(update={"plane_markers": [known]}), TARGET_M) is None
    )


TIME_S = np.arange(200) / 500
DISC = np.zeros(2), 0.010  # the target: place and radius [m]
SPEED, AT_S = 6.0, 0.2031  # m/s, and when the tip is nearest


def straight_tip(aside_m):
    return np.column_stack([SPEED * (TIME_S - AT_S), np.full(len(TIME_S), aside_m)])


def test_a_tip_that_passes_by_touches_nothing():
    seen = np.ones(len(TIME_S), bool)
    assert find_contact(TipPath(TIME_S, straight_tip(0.013), seen, 0.002), *DISC) is None
    seen[90:115] = False
    assert find_contact(TipPath(TIME_S, straight_tip(0.0), seen, 0.002), *DISC) is None


def test_contact_is_when_the_outlines_meet():
    contact = find_contact(
        TipPath(TIME_S, straight_tip(0.009), np.ones(len(TIME_S), bool), 0.005), np.zeros(2), 0.010
    )
    assert contact.camera_time_s == pytest.approx(AT_S - 0.012 / SPEED, abs=2e-4)
    assert contact.frame == 101  # the first at or after that
    assert 0.009 <= contact.distance_m < 0.0115
    assert contact.evidence == ["outlines"]


def test_a_blow_shows_in_the_tips_velocity():
    rng = np.random.default_rng(0)
    tip = straight_tip(0.0) + 0.0003 * rng.normal(size=(200, 2))
    struck = tip.copy()
    after = TIME_S > AT_S - 0.01 / SPEED
    struck[after] = struck[after][0] * [1, 0] + np.column_stack(
        [-2.0 * (TIME_S[after] - TIME_S[after][0]), 3.0 * (TIME_S[after] - TIME_S[after][0])]
    )
    struck[after] += 0.0003 * rng.normal(size=(after.sum(), 2))
    seen = np.ones(len(TIME_S), bool)
    assert find_contact(TipPath(TIME_S, tip, seen, 0.003), *DISC).evidence == ["outlines"]
    assert find_contact(TipPath(TIME_S, struck, seen, 0.003), *DISC).evidence == [
        "outlines",
        "tip",
    ]


def test_a_target_that_was_knocked_away_looks_different(scene):
    rng = np.random.default_rng(0)
    there, gone = wall(scene, edges=False), wall(scene, edges=False)
    disc(scene, there, TARGET_M, 0.01, 220)
    middle = scene.to_pixels(TARGET_M)

    def filmed(after):
        scenes = [picture.copy() for picture in [there] * 6 + [after] * 6]
        scene.draw_line(scenes[8], np.array([middle - 60, middle + 60]), 3, 250)  # the string, passing
        return [np.clip(s + rng.normal(0, 2.5, s.shape), 0, 255).astype(np.uint8) for s in scenes]

    frames = np.arange(12) * 20
    assert target_changed(filmed(gone), frames, 110, middle, 6.7)
    assert not target_changed(filmed(there), frames, 110, middle, 6.7)
    assert not target_changed(filmed(gone), frames, 30, middle, 6.7)  # two pictures before: not enough


def test_all_evidence_is_reported_together(scene):
    rng = np.random.default_rng(0)
    there, gone = wall(scene, edges=False), wall(scene, edges=False)
    disc(scene, there, TARGET_M, 0.01, 220)
    target = locate_target(sensed(there), scene.flat_camera(), TARGET_M)
    scenes = [there] * 6 + [gone] * 6
    pictures = [np.clip(s + rng.normal(0, 2.5, s.shape), 0, 255).astype(np.uint8) for s in scenes]
    tip = TipPath(TIME_S, straight_tip(0.0) + TARGET_M, np.ones(len(TIME_S), bool), 0.002)
    camera, samples = scene.flat_camera(), Samples(12, 1)
    samples.pictures, samples.indices = pictures, (18 * np.arange(12)).tolist()
    assert detect_contact(tip, None, camera, samples) is None
    assert detect_contact(tip, target, camera, samples).evidence == ["outlines", "target"]
    samples.pictures = pictures[:6] * 2
    assert detect_contact(tip, target, camera, samples).evidence == ["outlines"]
