"""A wrongly declared length is corrected from the video and reported."""

import numpy as np
import pytest

from strandcast.core.hand_marker import HandMarker
from strandcast.tracking.chain.clamp_fit import ClampFit
from strandcast.tracking.scene_checks import length_faults


@pytest.mark.parametrize("given_m", [0.27, pytest.param(0.33, marks=pytest.mark.thorough)])
def test_a_declared_length_off_by_a_tenth_is_corrected_and_reported(scene, filmed, given_m):
    path, _, curves = filmed
    tracked = scene.track(path, given_m)
    assert tracked.choices["length_m"] == pytest.approx(0.3, abs=0.003)
    assert any("string.length_m" in text for text in tracked.warnings)
    off = np.linalg.norm(tracked.points_m[:, -1] - curves[:, -1], axis=1)
    sure = tracked.flags[:, -1] == 0
    assert sure.mean() > 0.8
    assert np.nanmedian(off[sure]) < 1e-3


def test_a_length_off_by_more_than_its_error_is_reported_with_the_right_one():
    seen = ClampFit(0.480, 0.0012, 0.0, 0.001, 200)
    (fault,) = length_faults(seen, 0.494, 0.504, 0.001)  # 3 %, and seven standard errors
    assert "480.0 ± 1.6 mm hang from the clamp, not 494.0 mm" in fault.what
    assert "As seen, it is 0.490" in fault.fix
    assert length_faults(seen, 0.485, 0.495, 0.001) == []  # as a hand clamps a string
    assert length_faults(seen, 0.494, 0.504, 0.01) == []  # the end is not known well


def test_markers_that_contradict_the_arms_file_are_reported(scene, filmed):
    smaller = HandMarker(7, 0.9 * scene.MARKER_M, scene.MARKER_PLACE_M)
    with pytest.raises(Exception, match="not of the sizes"):
        scene.track(filmed[0], markers=(smaller,))
