"""The warning about an exposure that the tracker assumed, for real cameras only."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from strandcast.camera.flat import flat_camera
from strandcast.stages.track import _assumed_exposure


@pytest.mark.parametrize(
    ("is_lab", "given_s", "assumed_s", "warned"),
    [
        (False, None, 0.8e-3, True),
        (True, None, 0.8e-3, False),
        (False, 0.5e-3, 0.5e-3, False),
        (False, None, None, False),  # another tracker, which uses no exposure
    ],
)
def test_an_assumed_exposure_is_a_warning(
    is_lab: bool, given_s: float | None, assumed_s: float | None, warned: bool
) -> None:
    settings = SimpleNamespace(camera=SimpleNamespace(exposure_s=given_s))
    job: Any = SimpleNamespace(is_lab=is_lab, context=SimpleNamespace(settings=settings))
    time_s = np.arange(10) / 250.0
    points_m = np.zeros((10, 2, 2))
    points_m[:, 1, 0] = 5.0 * time_s
    choices = {} if assumed_s is None else {"exposure_s": assumed_s}
    tracked: Any = SimpleNamespace(points_m=points_m, camera_time_s=time_s, choices=choices)
    found = _assumed_exposure(job, tracked, flat_camera(640, 480, 2e-3, (0.0, 0.0)))
    assert ["camera.exposure_s is not given" in text for text in found] == [True] * warned
