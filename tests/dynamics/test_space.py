"""What callers rely on of strings in space, apart from the physics: batches, paths, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from arrays import evaluate_batch, simulate_batch, start_shape
from proofs_dynamics import MASSES, hand_path
from proofs_space import (
    CURL_RAD_M,
    FACTOR,
    OUT_S,
    STRING,
    SWITCH,
    TIME_S,
    first_clamp,
    pose_of,
    poses_in_plane,
    second_clamp,
    start_of,
    string_of,
)

from strandcast.core.strings import StringBatch
from strandcast.dynamics.batch import HandPath
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.simulate import BLEW_UP, OK
from strandcast.dynamics.simulate import simulate_batch as simulate
from strandcast.dynamics.spatial.clamps import clamp_poses, hanging_clamp_poses

MODEL = StringModel(0.2, 5)
POSE = np.array([pose_of(first_clamp(t)) for t in TIME_S])
BOTH = np.hstack([POSE, [pose_of(second_clamp(t)) for t in TIME_S]])


def batch_of(size):
    rng = np.random.default_rng(1)
    return STRING * rng.uniform(0.8, 1.2, (size, 10)), np.repeat(MASSES[None], size, axis=0)


def test_each_string_follows_its_own_path():
    parameters, masses = batch_of(3)
    poses = np.stack([POSE + np.r_[0.1 * k, np.zeros(8)] for k in range(3)])
    own, status = simulate_batch(MODEL, parameters, masses, TIME_S, poses, OUT_S)
    assert (status == OK).all()
    for k in range(3):
        one, _ = simulate_batch(MODEL, parameters[k : k + 1], masses[:1], TIME_S, poses[k], OUT_S)
        np.testing.assert_allclose(own[k], one[0], atol=1e-12)


@pytest.mark.parametrize("pose", [POSE, BOTH], ids=["one end", "two ends"])
def test_driven_points_follow_the_clamps(pose):
    parameters, masses = batch_of(2)
    points, _ = simulate_batch(MODEL, parameters, masses, TIME_S, pose, TIME_S[::100])
    np.testing.assert_allclose(points[:, :, 0], np.broadcast_to(pose[::100, :3], points[:, :, 0].shape))
    if pose is BOTH:
        tip = np.broadcast_to(pose[::100, 9:12], points[:, :, -1].shape)
        np.testing.assert_allclose(points[:, :, -1], tip, atol=1e-9)


def test_values_are_the_distances():
    parameters, masses = batch_of(9)
    points, _ = simulate_batch(MODEL, parameters, masses, TIME_S, BOTH, OUT_S)
    measured = points[0, :, 1:] + [0.01, -0.02, 0.02]
    weight = np.random.default_rng(2).random(measured.shape[:2])
    values, _ = evaluate_batch(MODEL, parameters, masses, TIME_S, BOTH, OUT_S, measured, weight)
    distance = np.linalg.norm(points[:, :, 1:] - measured, axis=3)
    np.testing.assert_allclose(values, (distance * weight).sum(axis=(1, 2)), rtol=1e-9)
    assert values[0] == pytest.approx(0.03 * weight.sum())


@pytest.mark.thorough
def test_any_register_gives_the_same_strings(monkeypatch):
    parameters, masses = batch_of(3)
    wide, _ = simulate_batch(MODEL, parameters, masses, TIME_S, BOTH, OUT_S)
    monkeypatch.setenv("STRANDCAST_REGISTER_BITS", "0")
    plain, _ = simulate_batch(MODEL, parameters, masses, TIME_S, BOTH, OUT_S)
    np.testing.assert_allclose(plain, wide, atol=1e-9)


def test_settled_string_stays():
    parameters, masses = batch_of(1)
    still = np.array([0.0, 0.3])
    pose = np.repeat(BOTH[:1], 2, axis=0)
    points, _ = simulate_batch(
        MODEL, parameters, masses, still, pose, np.array([0.0, 0.3]), start_of(two_ends=True), settle=True
    )
    assert np.abs(points[0, 1] - points[0, 0]).max() < 1e-7
    assert np.abs(points[0, 0, 1:-1] - start_of(two_ends=True)[:-1]).max() > 5e-3


def test_a_longer_string_hangs_lower():
    pose = clamp_poses(np.zeros((1, 3)), np.array([[0.0, 0.0, -1.0]]))[0]
    usual, longer = (
        start_shape(MODEL, STRING, MASSES, pose, length_change=change)[-1, 2] for change in (0.0, 0.02)
    )
    assert longer - usual == pytest.approx(-0.004, rel=1e-6)


def test_strong_damping_is_stable_at_large_steps():
    coarse, fine = (
        replace(MODEL, reading="strain", switch_width=SWITCH["strain"], dt_s=step) for step in (2e-3, 6.25e-5)
    )
    string = {"rest_curl_rad_m": CURL_RAD_M[None], "bend_factor": np.array([FACTOR]), "respace": False}
    damped, start = string_of(30.0)[None], start_of(two_ends=True)
    (large, status), (small, _) = (
        simulate_batch(each, damped, MASSES[None], TIME_S, BOTH, OUT_S, start, **string)
        for each in (coarse, fine)
    )
    assert (status == OK).all()
    np.testing.assert_allclose(large, small, atol=5e-4)


def test_a_blow_up_is_reported():
    parameters, masses = batch_of(2)
    parameters[1, 0] = np.nan
    points, status = simulate_batch(MODEL, parameters, masses, TIME_S, POSE, OUT_S, start_of(two_ends=False))
    assert list(status) == [OK, BLEW_UP]
    assert np.isfinite(points[0]).all()
    assert np.isnan(points[1, -1, -1]).all()


def test_normals_are_transported_without_roll():
    turn = np.linspace(0.0, 1.0, 200)
    direction = np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])
    pose = clamp_poses(np.zeros((200, 3)), 3.0 * direction)
    np.testing.assert_allclose(pose[:, 8], pose[0, 8], atol=1e-12)  # the vertical part of the normal


def test_a_hanging_roll_depends_on_the_direction_alone():
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    around = np.column_stack([np.cos(turn), np.sin(turn), np.full_like(turn, -0.5)])
    pose = hanging_clamp_poses(np.zeros((200, 3)), 3.0 * around)
    np.testing.assert_allclose(pose[-1], pose[0], atol=1e-12)
    np.testing.assert_allclose((pose[:, 3:6] * pose[:, 6:9]).sum(axis=1), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(pose[:, 6:9], axis=1), 1.0)
    # The least turn from downwards to the y axis is about the x axis.
    np.testing.assert_allclose(hanging_clamp_poses(np.zeros((1, 3)), np.eye(3)[1:2])[0, 6:9], np.eye(3)[0])
    with pytest.raises(ValueError, match="straight up"):
        hanging_clamp_poses(np.zeros((1, 3)), np.array([[0.0, 0.0, 2.0]]))


@pytest.mark.parametrize("poses", [clamp_poses, hanging_clamp_poses])
@pytest.mark.parametrize("size", [0.0, np.nan, np.inf])
def test_a_direction_without_a_length_is_refused(poses, size):
    direction = np.array([[1.0, 0.0, 0.0], [size, 0.0, 0.0]])
    with pytest.raises(ValueError, match="finite length above 0"):
        poses(np.zeros((2, 3)), direction)


def test_a_reversed_direction_has_no_transported_normal():
    there = np.array([[1.0, 0.0, 0.0], [-1.0, 1e-9, 0.0]])
    with pytest.raises(ValueError, match="reversed at sample 1"):
        clamp_poses(np.zeros((2, 3)), there)
    almost = clamp_poses(np.zeros((2, 3)), np.array([[1.0, 0.0, 0.0], [-1.0, 1e-3, 0.0]]))
    assert np.abs((almost[:, 3:6] * almost[:, 6:9]).sum(axis=1)).max() < 1e-9


def test_what_exists_in_the_plane_only_is_refused():
    parameters, masses = batch_of(1)
    flat = hand_path(TIME_S)
    up = poses_in_plane(flat, np.zeros(3), np.eye(3)[0], np.eye(3)[2])
    with pytest.raises(ValueError, match="a bend in space has no sign"):
        simulate_batch(replace(MODEL, reading="sign"), parameters, masses, TIME_S, up, OUT_S)
    with pytest.raises(ValueError, match="settled from a given shape in space only"):
        simulate_batch(MODEL, parameters, masses, TIME_S, flat, OUT_S, settle=True)
    with pytest.raises(ValueError, match="one rest curl and the model's length"):
        simulate_batch(MODEL, parameters, masses, TIME_S, flat, OUT_S, length_change=0.01)
    with pytest.raises(ValueError, match="do not fit hand poses"):
        simulate_batch(MODEL, parameters, masses, TIME_S, up[:, :7], OUT_S)
    far = StringBatch(parameters, masses).with_values(far_offset_rad=np.array([[0.0, 0.1]]))
    for pose in (flat, up):
        with pytest.raises(ValueError, match="only a second clamp has an offset"):
            simulate(MODEL, far, HandPath(TIME_S, pose), OUT_S)
