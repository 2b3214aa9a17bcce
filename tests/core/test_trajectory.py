"""A joint trajectory is the quintic through its samples, at rest outside them."""

import numpy as np
import pytest

from strandcast.core.trajectory import JointTrajectory


def quintic(time_s: np.ndarray) -> JointTrajectory:
    """Return q = t^5 - t^2 and its derivatives, one joint."""
    t = np.asarray(time_s, float)[:, None]
    return JointTrajectory(t[:, 0], t**5 - t**2, 5 * t**4 - 2 * t, 20 * t**3 - 2)


def test_a_quintic_is_reproduced_between_uneven_samples() -> None:
    between = np.array([0.7, 0.01, 0.33, 1.2])
    found, expected = quintic(np.array([0.0, 0.4, 0.5, 1.3])).at(between), quintic(between)
    np.testing.assert_allclose(found.q_rad, expected.q_rad, atol=1e-13)
    np.testing.assert_allclose(found.qd_rad_s, expected.qd_rad_s, atol=1e-12)
    np.testing.assert_allclose(found.qdd_rad_s2, expected.qdd_rad_s2, atol=1e-11)


def test_outside_its_samples_it_stands_still() -> None:
    found = quintic(np.array([1.0, 2.0])).at(np.array([0.5, 2.5]))
    np.testing.assert_allclose(found.q_rad[:, 0], [0.0, 28.0], atol=1e-12)
    assert not found.qd_rad_s.any()
    assert not found.qdd_rad_s2.any()


@pytest.mark.parametrize(("step_s", "count"), [(0.25, 5), (0.3, 5), (0.5, 3), (2.0, 2)])
def test_resampling_ends_at_the_end(step_s: float, count: int) -> None:
    resampled = quintic(np.array([0.0, 0.6, 1.0])).resampled(step_s)
    assert len(resampled.time_s) == count
    assert resampled.time_s[0] == 0.0
    assert resampled.end_s == 1.0
