"""The hand's pose from its markers, decoded once and then tracked by their corners."""

import cv2
import numpy as np
import pytest

from strandcast.core.hand_marker import HandMarker
from strandcast.core.pose import Pose
from strandcast.tracking.hand.finder import HandFinder
from strandcast.tracking.hand.rigid import box_around, fit_rigid, place


def pictures(scene, poses, blank=()):
    rng = np.random.default_rng(0)
    for index, pose in enumerate(poses):
        image = np.full((scene.HEIGHT, scene.WIDTH), 150.0, np.float32)
        if index not in blank:
            square = scene.MARKER_M * 0.5 * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
            scene.draw_marker(
                image, scene.to_pixels(place(Pose.from_array(pose), square + scene.MARKER_PLACE_M)), 7
            )
        yield np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)


@pytest.fixture
def finder(scene):
    marker = HandMarker(7, scene.MARKER_M, scene.MARKER_PLACE_M)
    return HandFinder(scene.flat_camera(), [marker], "DICT_4X4_50", 0.0)


def test_pose_is_found_and_tracked(scene, finder):
    turn = np.linspace(0.3, 1.5, 25)
    poses = np.column_stack([0.1 * np.cos(turn), 0.1 * np.sin(turn), turn - 0.7])
    seen = [finder.find(picture) for picture in pictures(scene, poses)]
    off = np.array([hand.pose.array() for hand in seen if hand is not None]) - poses
    assert len(off) == 25
    assert np.sqrt((off[:, :2] ** 2).sum(axis=1).mean()) < 2e-4
    assert np.abs(off[:, 2]).max() < 0.004
    sigma = np.mean([hand.sigma_m for hand in seen if hand is not None])
    assert 5e-5 < sigma < 1e-3


def test_a_hidden_marker_gives_no_pose_and_is_found_again(scene, finder):
    poses = np.tile([0.05, 0.02, 0.3], (6, 1))
    seen = [finder.find(picture) is not None for picture in pictures(scene, poses, blank=(2, 3))]
    assert seen == [True, True, False, False, True, True]


def test_a_blurred_marker_gives_no_pose_or_the_right_one(scene, finder):
    """Each third frame is blurred along a direction of its own, over one to three cells of the marker."""
    turn = np.linspace(0.3, 1.5, 24)
    poses = np.column_stack([0.1 * np.cos(turn), 0.1 * np.sin(turn), turn - 0.7])
    cell_px = scene.MARKER_M / scene.SCALE_M / 6
    off = np.full((len(poses), 3), np.nan)
    for k, picture in enumerate(pictures(scene, poses)):
        if k % 3 == 2:
            width = int(cell_px * (1 + k // 8)) | 1
            picture = cv2.blur(picture, (width, 1) if k % 2 else (1, width))
        hand = finder.find(picture)
        if hand is not None:
            off[k] = hand.pose.array() - poses[k]
    sharp = np.arange(len(poses)) % 3 != 2
    assert np.isfinite(off[sharp]).all()
    assert np.abs(off[sharp, :2]).max() < 5e-4
    assert np.isnan(off[~sharp]).any()  # they were blurred enough to matter
    assert np.nanmax(np.abs(off[:, :2])) < 1.5e-3


def test_rigid_fit_is_exact_for_a_turned_square():
    model = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 2.0]])
    pose, residual = fit_rigid(model, place(Pose.from_array(np.array([0.3, -0.2, 2.5])), model))
    np.testing.assert_allclose(pose.array(), [0.3, -0.2, 2.5], atol=1e-12)
    np.testing.assert_allclose(residual, 0.0, atol=1e-12)


def test_box_ends_where_the_string_leaves():
    box = box_around([HandMarker(1, 0.05, (-0.03, 0.0))])
    np.testing.assert_allclose(box, [-0.0675, -0.0375, 0.0, 0.0375])
