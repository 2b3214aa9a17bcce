"""The peers integrate the string that they are timed on, as far as each of them can."""

import numpy as np
import pytest

from strandcast.core.strings import StringBatch
from strandcast.dynamics.batch import HandPath
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.simulate import simulate_batch
from strandcast_studies.benchmarks.simulation.numpy_string import NumpyString
from strandcast_studies.benchmarks.simulation.swing import (
    CAST,
    COMMON_S,
    LENGTH_M,
    MASSES,
    SEGMENTS,
    plain,
    table_2,
)

PEERS = "strandcast_studies.benchmarks.simulation"

#          k_s  c_s  k_h   c_h   k_sh  c_sh  c1   c2   k_ph  c_ph
MILD = np.array([2e5, 5.0, 0.05, 0.02, 0.05, 0.02, 0.0, 0.0, 5e-3, 5e-3])


def with_values(parameters, **values):
    names = ("k_s", "c_s", "k_h", "c_h", "k_sh", "c_sh", "c1", "c2", "k_ph", "c_ph")
    return np.array([values.get(name, value) for name, value in zip(names, parameters, strict=True)])


def ours(parameters, dt_s, masses=MASSES):
    time_s = np.linspace(0.0, 1.0, 2001)
    model = StringModel(LENGTH_M, SEGMENTS, dt_s=dt_s, reading="sign")
    hand = HandPath(time_s, CAST.at(time_s)[0])
    return simulate_batch(model, StringBatch(parameters[None], masses[None]), hand, COMMON_S)[0][0]


def apart_mm(peer, parameters, *reference, frames=None, **settings):
    apart = peer.positions()[0] - ours(parameters, *reference, **settings)
    return 1e3 * np.sqrt((apart[:frames] ** 2).sum(-1).mean())


@pytest.mark.thorough
def test_numpy_converges_to_ours():
    varied = with_values(MILD, k_sh=0.02, c_sh=0.005, c1=0.1, c2=0.2)
    apart = [apart_mm(NumpyString(CAST, varied[None], dt_s), varied, 1e-4) for dt_s in (2.5e-4, 1.25e-4)]
    assert apart[1] < 0.03
    assert apart[0] / apart[1] == pytest.approx(2.0, rel=0.1)  # its scheme is of first order


def test_hinges_are_the_limit_of_stiff_segments():
    chains = pytest.importorskip(
        "strandcast_studies.benchmarks.simulation.mujoco_chain", reason="needs MuJoCo", exc_type=ImportError
    )
    peer = chains.HingeChain(CAST, MILD[None], 1e-3, threads=1)
    distances = [apart_mm(peer, with_values(MILD, k_s=k_s), 2.5e-4) for k_s in (1e6, 1e7, 1e8)]
    assert distances[2] < 0.5
    assert distances[0] / distances[1] == pytest.approx(10.0, rel=0.3)
    assert distances[1] / distances[2] == pytest.approx(10.0, rel=0.3)


def test_flex_with_springs_is_our_string_free_in_the_hand():
    flexes = pytest.importorskip(
        "strandcast_studies.benchmarks.simulation.mujoco_flex", reason="needs MuJoCo", exc_type=ImportError
    )
    free = with_values(MILD, k_ph=1e-6, c_ph=1e-6)
    peer = flexes.SpringFlex(CAST, free[None], 5e-4, threads=1)
    assert apart_mm(peer, free, 2.5e-4) < 0.2


def test_discrete_flex_follows_the_hand_on_edges_that_give_a_little():
    flexes = pytest.importorskip(
        "strandcast_studies.benchmarks.simulation.mujoco_flex", reason="needs MuJoCo", exc_type=ImportError
    )
    found = flexes.DiscreteFlex(CAST, MILD[None], 1e-3, threads=1).positions()[0]
    hand = CAST.at(COMMON_S)[0][:, :2]
    np.testing.assert_allclose(found[:, 0], hand, atol=1e-6)
    length = np.linalg.norm(np.diff(found, axis=1), axis=2).sum(axis=1)
    np.testing.assert_allclose(length, LENGTH_M, atol=0.1 * LENGTH_M)


def test_rod_of_pyelastica_swings_alike():
    rods = pytest.importorskip(
        "strandcast_studies.benchmarks.simulation.pyelastica",
        reason="needs the packages of `make bench`",
        exc_type=ImportError,
    )
    # Half a second of a stiff string: its bending shows, and the rod's missing dampers do not yet.
    stiff = with_values(MILD, c_s=0.0, k_h=50.0, k_sh=50.0, c_h=0.0, c_sh=0.0, c1=2.0, k_ph=1e-6, c_ph=1e-6)
    peer = rods.CosseratRod(CAST, stiff[None], 1.25e-4)
    half_at_the_tip = np.r_[MASSES[1:], 0.5]
    assert apart_mm(peer, stiff, 2.5e-4, masses=half_at_the_tip, frames=250) < 6.0
    np.testing.assert_array_equal(peer.positions(), peer.positions())


def test_common_strings_have_one_bending_and_no_air():
    strings = plain(table_2(50, 1))
    assert (strings[:, 2] == strings[:, 4]).all()
    assert (strings[:, 3] == strings[:, 5]).all()
    assert not strings[:, 6:8].any()
    assert strings[:, 2].min() > 1e-4
    assert strings[:, 2].max() < 10.0


def test_swing_starts_and_ends_at_rest_and_its_rate_is_its_slope():
    time_s = np.linspace(0.0, 1.0, 10001)
    pose, rate = CAST.at(time_s)
    np.testing.assert_allclose(np.gradient(pose, time_s, axis=0)[1:-1], rate[1:-1], atol=1e-5)
    np.testing.assert_allclose(rate[[0, -1]], 0.0, atol=1e-12)
    assert np.linalg.norm(rate[:, :2], axis=1).max() == pytest.approx(CAST.fastest_m_s(), rel=1e-6)
    assert pose[0, 2] == -np.pi / 2
