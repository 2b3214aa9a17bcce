import numpy as np

from strandcast.core.pose import Pose, rotated, wrapped


def test_places_a_point_of_the_frame() -> None:
    pose = Pose(np.array([1.0, 2.0]), np.array(np.pi / 2))
    np.testing.assert_allclose(pose.place(np.array([0.3, 0.1])), [0.9, 2.3], atol=1e-15)


def test_many_poses_place_one_point_each() -> None:
    pose = Pose.from_array(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, np.pi]]))
    np.testing.assert_allclose(pose.place(np.array([[0.2, 0.1], [0.2, 0.1]])), [[0.2, 0.1], [0.8, -0.1]])
    assert len(pose) == 2
    np.testing.assert_array_equal(pose[1].array(), [1.0, 0.0, np.pi])


def test_an_array_survives_the_round_trip() -> None:
    values = np.random.default_rng(1).standard_normal((4, 5, 3))
    np.testing.assert_array_equal(Pose.from_array(values).array(), values)
    assert Pose.from_array(values).array().flags.c_contiguous


def test_angles_stay_continuous() -> None:
    pose = Pose(np.zeros((3, 2)), np.array([3.0, -3.0, 3.0]))
    np.testing.assert_allclose(
        pose.near(np.array([9.0, 3.0, -3.0])).angle_rad, [3 + 2 * np.pi, 2 * np.pi - 3, 3 - 2 * np.pi]
    )


def test_interpolates_linearly_in_time() -> None:
    pose = Pose.from_array(np.array([[0.0, 1.0, 2.0], [1.0, 3.0, 6.0]]))
    found = pose.interpolated(np.array([0.0, 1.0]), np.array([-1.0, 0.25, 2.0]))
    np.testing.assert_allclose(found.array(), [[0.0, 1.0, 2.0], [0.25, 1.5, 3.0], [1.0, 3.0, 6.0]])


def test_turns_vectors_and_wraps_angles() -> None:
    np.testing.assert_allclose(rotated(np.array([[1.0, 0.0]]), np.array([np.pi / 6])), [[np.sqrt(0.75), 0.5]])
    np.testing.assert_allclose(wrapped(np.array([4.0, -np.pi, np.pi])), [4.0 - 2 * np.pi, -np.pi, -np.pi])
