"""No motion passes whose set points break a limit, whatever its file states; every planned one does."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BPoly

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import StrandcastError
from strandcast.executor.checks import check_motion, check_set_points
from strandcast.planning.bezier import sample
from strandcast.planning.draw import CurvePrior, JointBounds, draw_first

from .motions import motion_of

ARMS = Path(__file__).parents[2] / "config" / "arms"
FILE = Path("motion.json")
RATES_HZ = (125.0, 240.0, 500.0, 1000.0)

Array = np.ndarray
Rng = np.random.Generator
Columns = tuple[Array, Array, Array, Array]  # time, angles, speeds, accelerations


@cache
def planned(count: int, seed: int) -> list[tuple[PlanarArm, JointTrajectory]]:
    """Return motions within the limits of three arms, one also with a slow tool, some of them at a limit."""
    found = []
    arms = [load_arm(ARMS / f"{name}.toml").planar() for name in ("planar3", "ur5e-example", "fr3-example")]
    slow = replace(arms[0].limits, whole_arm=np.array([0.9, 1.0, 0.5, *[np.inf] * 5]))
    for arm in (*arms, replace(arms[0], limits=slow)):
        bounds = JointBounds(arm, 0.002, arm.dynamics)
        prior = CurvePrior("rest", (0.3, 0.9), 60.0)
        curves = draw_first(count, prior, bounds, np.random.default_rng(seed))
        found += [(arm, sample(curve, 0.002)) for curve in curves]
    return found


def refusal(arm: PlanarArm, columns: Columns) -> str | None:
    """Return the code with which a dry run refuses a motion."""
    try:
        motion = motion_of(arm, np.rint(1e9 * columns[0]).astype(np.int64), *columns[1:])
        check_motion(FILE, motion, arm)
        for rate_hz in RATES_HZ:
            check_set_points(FILE, motion, arm, rate_hz)
    except StrandcastError as error:
        return error.code
    except ValueError:  # the record's own refusal
        return "record"
    return None


def one_angle_jumps(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    q[rng.integers(1, len(t) - 1), rng.integers(q.shape[1])] += rng.normal() * 10.0 ** rng.uniform(-5, 0)
    return t, q, qd, qdd


def saw_tooth(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    q[1:-1:2] += 10.0 ** rng.uniform(-6, -2)
    return t, q, qd, qdd


def noise(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    q[1:-1] += 10.0 ** rng.uniform(-8, -2) * rng.normal(size=q[1:-1].shape)
    return t, q, qd, qdd


def larger(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    by = rng.uniform(1.0, 2.0)
    return t, q[0] + by * (q - q[0]), by * qd, by * qdd


def faster(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    by = rng.uniform(1.0, 2.0)
    return t / by, q, by * qd, by**2 * qdd


def faster_unsaid(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    return t / rng.uniform(0.5, 3.0), q, qd, qdd


def jitter_of_times(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    t[1:-1] += 10.0 ** rng.uniform(-8, -3) * rng.normal(size=len(t) - 2)
    return t, q, qd, qdd


def a_step_is_shorter(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    k = rng.integers(1, len(t) - 1)
    t[k:] -= rng.uniform(0.1, 1.0) * (t[k] - t[k - 1])
    return t, q, qd, qdd


def no_accelerations(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    return t, q, qd, 0.0 * qdd


def no_derivatives(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    return t, q, 0.0 * qd, 0.0 * qdd


def other_derivatives(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    return t, q, rng.uniform(-2.0, 2.0) * qd, rng.uniform(-2.0, 2.0) * qdd


def derivatives_in_degrees(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    return t, q, np.degrees(qd), np.degrees(qdd)


def denser_without_accelerations(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    by = rng.uniform(1.0, 3.0)
    fine = JointTrajectory(t, q, qd, qdd).resampled(10.0 ** rng.uniform(-3.5, -2.5))
    return fine.time_s / by, fine.q_rad, fine.qd_rad_s * by, 0.0 * fine.qdd_rad_s2


def sparser(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    keep = np.append(np.arange(0, len(t) - 1, rng.integers(2, 60)), len(t) - 1)
    return t[keep], q[keep], qd[keep] * rng.choice([0.0, 1.0]), qdd[keep] * rng.choice([0.0, 1.0])


def jump_between_two_instants(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    k = rng.integers(1, len(t) - 1)
    t, q, qd, qdd = (np.insert(x, k, x[k], axis=0) for x in (t, q, qd, qdd))
    t[k] -= 10.0 ** rng.uniform(-8, -4)
    q[k + 1 :] += 10.0 ** rng.uniform(-6, 0) * rng.normal(size=q.shape[1])
    return t, q, qd, qdd


def two_points_exchanged(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    one, two = rng.integers(1, len(t) - 1, 2)
    for x in (q, qd, qdd):
        x[[one, two]] = x[[two, one]]
    return t, q, qd, qdd


def points_in_another_order(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    order = rng.permutation(len(t)) if rng.random() < 0.5 else np.arange(len(t))[::-1]
    return t[order], q[order], qd[order], qdd[order]


def joints_exchanged(rng: Rng, t: Array, q: Array, qd: Array, qdd: Array) -> Columns:
    order = rng.permutation(q.shape[1])
    return t, q[:, order], qd[:, order], qdd[:, order]


MUTATIONS: tuple[Callable[..., Columns], ...] = (
    *(one_angle_jumps, saw_tooth, noise, larger, joints_exchanged),
    *(faster, faster_unsaid, jitter_of_times, a_step_is_shorter),
    *(no_accelerations, no_derivatives, other_derivatives, derivatives_in_degrees),
    *(denser_without_accelerations, sparser, jump_between_two_instants),
    *(two_points_exchanged, points_in_another_order),
)


def mutants(count: int, seed: int) -> Iterator[tuple[str, PlanarArm, Columns]]:
    rng, good = np.random.default_rng(seed), planned(20, seed)
    for k in range(count):
        arm, motion = good[rng.integers(len(good))]
        mutate = MUTATIONS[k % len(MUTATIONS)]
        slower = rng.choice([1.0, rng.uniform(1.0, 4.0)])
        columns = (
            *(motion.time_s * slower, motion.q_rad.copy()),
            *(motion.qd_rad_s / slower, motion.qdd_rad_s2 / slower**2),
        )
        yield mutate.__name__, arm, mutate(rng, *columns)


def worst_share(arm: PlanarArm, columns: Columns) -> float:
    """Return the largest share of a limit that set points take, by differences of their own."""
    limits, shares = arm.limits, []
    quintic = BPoly.from_derivatives(columns[0], np.stack(columns[1:], axis=1))
    for rate_hz in RATES_HZ:
        time_s = np.arange(round(columns[0][-1] * rate_hz) + 1) / rate_hz
        q = quintic(np.minimum(time_s, columns[0][-1]))
        q = np.vstack([q[[0, 0, 0]], q, q[[-1, -1, -1]]])
        most = (limits.velocity_rad_s, limits.acceleration_rad_s2, limits.jerk_rad_s3)
        for order, limit in enumerate(most, 1):
            shares.append((np.abs(np.diff(q, order, axis=0)) * rate_hz**order / limit).max())
        clamp_m_s = np.linalg.norm(np.diff(arm.hand_m(q), axis=0), axis=1) * rate_hz
        shares.append(clamp_m_s.max() / limits.whole_arm[1])
        shares.append(1.0 + np.maximum(q - limits.upper_rad, limits.lower_rad - q).max())
    by_points = np.abs(np.diff(columns[1], axis=0)) / np.diff(columns[0])[:, None]
    return float(max(*shares, (by_points / limits.velocity_rad_s).max()))


def outcomes(count: int, seed: int) -> Counter[tuple[str, str | None]]:
    """Return how many mutants of each kind were refused with which code; check those that were not."""
    found: Counter[tuple[str, str | None]] = Counter()
    for kind, arm, columns in mutants(count, seed):
        code = refusal(arm, columns)
        found[kind, code] += 1
        assert code is not None or worst_share(arm, columns) < 1.0 + 1e-6, (kind, arm.name)
    return found


def test_what_passes_keeps_the_limits() -> None:
    found = outcomes(60, 1)
    passed = sum(count for (_, code), count in found.items() if code is None)
    assert 3 < passed < 50


@pytest.mark.thorough
def test_what_passes_of_ten_thousand_keeps_the_limits(record_property: Callable[[str, object], None]) -> None:
    found = outcomes(10_000, 2)
    for kind in MUTATIONS:
        by_code = {str(code): count for (name, code), count in found.items() if name == kind.__name__}
        record_property(kind.__name__, str(by_code))
        print(kind.__name__, by_code)


def refused(count: int, seed: int) -> list[str]:
    motions = planned(count, seed)
    codes = [refusal(arm, (m.time_s, m.q_rad, m.qd_rad_s, m.qdd_rad_s2)) for arm, m in motions]
    return [code for code in codes if code is not None]


@pytest.mark.parametrize("points", [2, 3, 4, 6, 10, 100])
@pytest.mark.parametrize("duration_s", [1.0, 1.00001, 1.00000001])
def test_a_good_motion_of_few_points_or_an_odd_duration_is_accepted(points: int, duration_s: float) -> None:
    arm, s = load_arm(ARMS / "fr3-example.toml").planar(), np.linspace(0.0, 1.0, points)[:, None]
    way = np.array([0.3, 0.0, -0.2])
    q = way * s**3 * (10 - 15 * s + 6 * s**2) + arm.limits.lower_rad + 0.5
    qd = way * 30 * s**2 * (1 - s) ** 2 / duration_s
    qd[-1] = 5e-7  # at rest, as far as a file says so
    qdd = way * 60 * s * (1 - s) * (1 - 2 * s) / duration_s**2
    assert refusal(arm, (s[:, 0] * duration_s, q, qd, qdd)) is None


def test_no_planned_motion_is_refused() -> None:
    assert refused(10, 3) == []


@pytest.mark.thorough
def test_none_of_a_thousand_planned_motions_is_refused() -> None:
    assert refused(400, 4) == []
