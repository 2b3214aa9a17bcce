"""Frames in which the string is hidden, or followed wrongly, are tracked again from either side."""

from types import SimpleNamespace

import numpy as np
import pytest

from strandcast.tracking.chain.fit import FrameFit
from strandcast.tracking.chain.refine import retrack


def fit_with(heading_rad: float, value: float) -> FrameFit:
    """Return a fit of a chain with one link."""
    node, chain = np.zeros(2), np.array([heading_rad])
    return FrameFit(node, chain, 0.1, node, np.zeros((2, 2, 2)), 0.0, value, 1.0, False, False, 0)


class FollowsItsStart:
    """Finds the string (heading 1) from a state that has it, and something worse from any other."""

    def restart(self, states):
        self.right = any(state.heading[0] == 1.0 for state in states)

    def step(self, frame, *, search):
        return fit_with(1.0, 0.8) if self.right else fit_with(0.0, 0.5)


@pytest.mark.parametrize("anchor", [0, 11, 24])
def test_a_good_frame_amid_weak_ones_spreads_both_ways(anchor):
    fits = [fit_with(1.0, 0.9) if k < 4 else fit_with(0.0, 0.4) for k in range(25)]
    fits[12], fits[16] = fit_with(1.0, 0.85), None
    frames = SimpleNamespace(time_s=np.arange(25.0), at=lambda index: index)
    retrack(frames, fits, anchor, FollowsItsStart())
    assert [fit.heading[0] for fit in fits] == [1.0] * 25
    assert [fits[k].value for k in (0, 12, 24)] == [0.9, 0.85, 0.8]  # better fits are kept


@pytest.mark.parametrize(
    "hidden",
    [
        pytest.param((0, 12), marks=pytest.mark.thorough),
        (30, 38),
        pytest.param((58, 70), marks=pytest.mark.thorough),
    ],
)
def test_a_string_hidden_for_a_while_is_found_again_at_once(scene, tmp_path, hidden):
    path = tmp_path / "v.mkv"
    _, curves = scene.film(path, frames=70, hidden=hidden)
    tracked = scene.track(path)
    off = np.linalg.norm(tracked.points_m[:, -1] - curves[:, -1], axis=1)
    inside = np.zeros(70, bool)
    inside[slice(*hidden)] = True
    assert not (np.isfinite(off[inside]) & (tracked.flags[inside, -1] == 0)).any()
    open_again = ~inside
    assert np.isfinite(off[open_again]).mean() > 0.95
    assert off[open_again & (tracked.flags[:, -1] == 0)].max() < 3e-3
