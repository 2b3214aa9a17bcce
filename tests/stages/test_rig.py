"""Throws of one motion are compared with each other."""

from dataclasses import replace

import numpy as np
import pytest

from strandcast.planning.bezier import Curve, rest_heights
from strandcast.planning.past_trials import PastTrial
from strandcast.stages.rig import repeats


def test_tips_of_repeated_motions_are_compared_while_the_arm_moves() -> None:
    curve = Curve(np.zeros(2), 0.5, rest_heights(np.ones((2, 3))))
    frame_s = np.linspace(-0.1, 1.0, 111)
    tip_m = np.stack([np.sin(frame_s), np.cos(frame_s)], axis=1)
    still = np.zeros((10, 2))
    first = PastTrial(1, curve, still, still, frame_s, tip_m, None, 0.0, None)
    # 3 mm beside it during the motion, anywhere afterwards and before.
    beside_m = tip_m + np.array([0.003, 0.0])
    beside_m[(frame_s < -0.02) | (frame_s > curve.end_s + 0.02)] += 1.0
    again = replace(first, trial=3, tip_m=beside_m)
    # Seen in other frames, it is compared in between.
    again = replace(again, frame_s=frame_s[::2], tip_m=beside_m[::2])
    other = replace(first, trial=2, curve=replace(curve, heights_rad_s=1.01 * curve.heights_rad_s))
    (found,) = repeats([first, other, again])
    assert found.trials == (1, 3)
    assert found.tip_m == pytest.approx(0.003, abs=1e-4)
    blind = replace(again, tip_m=np.full_like(again.tip_m, np.nan))
    assert repeats([first, blind]) == []
    assert repeats([replace(first, curve=None), again]) == []
