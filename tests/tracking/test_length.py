"""A length that was measured wrong: found anew from what is seen, and told."""

from __future__ import annotations

import numpy as np
import pytest

from strandcast.tracking.hand import HandMarker
from strandcast.tracking.result import StringHint
from strandcast.tracking.track import track_video
from strandcast.video.ingest import inspect_video


@pytest.mark.parametrize("given_m", [0.27, 0.33])
def test_a_tenth_too_short_or_long_is_found_and_told(scene, filmed, given_m):
    path, _, curves = filmed
    marker = HandMarker(7, scene.MARKER_M, scene.MARKER_PLACE_M)
    tracked = track_video(path, inspect_video(path), scene.flat_camera(), StringHint(given_m, 10), [marker])
    assert tracked.choices["length_m"] == pytest.approx(0.3, abs=0.003)
    assert any("string.length_m" in text for text in tracked.warnings)
    off = np.linalg.norm(tracked.points_m[:, -1] - curves[:, -1], axis=1)
    sure = tracked.flags[:, -1] == 0
    assert sure.mean() > 0.8
    assert np.nanmedian(off[sure]) < 1e-3


def test_markers_that_contradict_the_arms_file_are_told(scene, filmed):
    path, _, _ = filmed
    size = HandMarker(7, 0.9 * scene.MARKER_M, scene.MARKER_PLACE_M)
    with pytest.raises(Exception, match="not of the sizes"):
        track_video(path, inspect_video(path), scene.flat_camera(), StringHint(0.3, 10), [size])
