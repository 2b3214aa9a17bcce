"""Following both ways: a frame in which the string cannot be found is bridged from either side."""

from __future__ import annotations

import numpy as np
import pytest

from strandcast.tracking.hand import HandMarker
from strandcast.tracking.passes import runs
from strandcast.tracking.result import StringHint
from strandcast.tracking.track import track_video
from strandcast.video.ingest import inspect_video


def test_runs_are_first_and_last():
    assert list(runs(np.array([1, 0, 1, 1, 0, 0, 1], bool))) == [(0, 0), (2, 3), (6, 6)]
    assert list(runs(np.zeros(3, bool))) == []


@pytest.mark.parametrize("hidden", [(0, 12), (30, 38), (58, 70)])
def test_a_string_hidden_for_a_while_is_found_again_at_once(scene, tmp_path, hidden):
    path = tmp_path / "v.mkv"
    _, curves = scene.film(path, frames=70, hidden=hidden)
    marker = HandMarker(7, scene.MARKER_M, scene.MARKER_PLACE_M)
    tracked = track_video(path, inspect_video(path), scene.flat_camera(), StringHint(0.3, 10), [marker])
    off = np.linalg.norm(tracked.points_m[:, -1] - curves[:, -1], axis=1)
    inside = np.zeros(70, bool)
    inside[slice(*hidden)] = True
    assert not (np.isfinite(off[inside]) & (tracked.flags[inside, -1] == 0)).any()
    open_again = ~inside
    assert np.isfinite(off[open_again]).mean() > 0.95
    assert off[open_again & (tracked.flags[:, -1] == 0)].max() < 3e-3
