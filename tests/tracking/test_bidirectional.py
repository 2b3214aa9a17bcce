"""Bidirectional tracking: frames in which the string is hidden are bridged from either side."""

import numpy as np
import pytest

from strandcast.tracking.chain.bidirectional import runs


def test_runs_are_first_and_last():
    assert list(runs(np.array([1, 0, 1, 1, 0, 0, 1], bool))) == [(0, 0), (2, 3), (6, 6)]
    assert list(runs(np.zeros(3, bool))) == []


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [(0, 12), (30, 38), (58, 70)])
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
