"""Weights that were seen but not declared: the fit is repeated with them, and both errors are reported."""

import re
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import load_arm
from strandcast.estimation.estimate import estimate
from strandcast.records.track import DetectedWeight
from strandcast.stages.context import context_of
from strandcast.stages.past_trials import string_model
from strandcast.stages.seen_weights import seen_weights_warnings

from ..estimation.known_string import LAYOUT, MODEL, observed_throw

PLACE_M = float(LAYOUT.places_m[0])


def warnings_of(root: Path, declared_m: float | None, seen_m: list[float]) -> list[str]:
    """Return the warnings about a string with a heavy weight at `PLACE_M`."""
    (root / "config" / "experiments").mkdir(parents=True)
    arms = Path(__file__).parents[2] / "config" / "arms"
    (root / "config" / "arms").symlink_to(arms)
    clamped_m = load_arm(arms / "planar3.toml").clamp.clamped_length_m
    weights = "" if declared_m is None else f", weights: [{{place_m: {declared_m}}}]"
    (root / "config" / "experiments" / "thrown.yaml").write_text(
        f"string: {{length_m: {MODEL.length_m + clamped_m}, points: {MODEL.points}{weights}}}\n"
        "target_m: [0.5, 0.5]\narm: planar3\nestimate: {profiles: false, dt_s: 2.0e-3}\n"
    )
    context = context_of(root, "thrown")
    arm = load_arm(context.arm_file)
    throws = [observed_throw(1.0)]
    random = np.random.default_rng(1)
    fit = estimate(throws, *string_model(context, arm), context.settings.estimate, random)
    seen = [DetectedWeight(place_m=place, sigma_m=1e-3, half_width_m=4e-3) for place in seen_m]
    return seen_weights_warnings(context, arm, throws, fit.E_m, seen, random)


@pytest.mark.parametrize("declared_m", [None, 0.05])
def test_a_weight_that_explains_the_throw_is_to_be_declared_where_it_is_seen(
    tmp_path: Path, declared_m: float | None
) -> None:
    (warning,) = warnings_of(tmp_path, declared_m, [PLACE_M])
    assert "a weight 200 mm from the clamp" in warning
    # One declared where none hangs is fitted as light: whether it is named too, the last digits decide.
    named = re.search(r"with weights at (.*) mm: declare these places$", warning)
    assert named
    assert named[1] in ("200", "50 and 200")


def test_a_mark_that_weighs_little_is_called_one(tmp_path: Path) -> None:
    (warning,) = warnings_of(tmp_path, PLACE_M, [PLACE_M, 0.06])
    assert warning.endswith("it may be a knot or a mark that weighs little")


def test_a_weight_seen_where_it_is_declared_is_no_news(tmp_path: Path) -> None:
    assert warnings_of(tmp_path, PLACE_M, [PLACE_M + 0.002]) == []
