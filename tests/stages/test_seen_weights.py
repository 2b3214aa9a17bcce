"""Weights that were seen but not declared: the fit is repeated with them, and both errors are reported."""

from pathlib import Path

import numpy as np

from strandcast.arm.load import load_arm
from strandcast.estimation.estimate import estimate_throws
from strandcast.records.record import RigFault
from strandcast.records.track import DetectedWeight
from strandcast.stages.context import context_of
from strandcast.stages.past_trials import string_model
from strandcast.stages.seen_weights import seen_weights

from ..estimation.known_string import LAYOUT, MODEL, observed_throw

PLACE_M = float(LAYOUT.places_m[0])


def found_in(root: Path, declared_m: float | None, seen_m: list[float]) -> tuple[list[RigFault], list[str]]:
    """Return what is found of a string with a heavy weight at `PLACE_M`."""
    (root / "config" / "experiments").mkdir(parents=True)
    arms = Path(__file__).parents[2] / "config" / "arms"
    (root / "config" / "arms").symlink_to(arms)
    clamped_m = load_arm(arms / "planar3.toml").planar().clamp.clamped_length_m
    weights = "" if declared_m is None else f", weights: [{{place_m: {declared_m}}}]"
    (root / "config" / "experiments" / "thrown.yaml").write_text(
        f"string: {{length_m: {MODEL.length_m + clamped_m}, points: {MODEL.points}{weights}}}\n"
        "target_m: [0.5, 0.5]\narm: planar3\n"
        "estimate: {evaluations: 400, profiles: false, dt_s: 2.0e-3}\n"
    )
    context = context_of(root, "thrown")
    arm = load_arm(context.arm_file).planar()
    throws = [observed_throw(1.0)]
    random = np.random.default_rng(1)
    fit = estimate_throws(throws, *string_model(context, arm), context.settings.estimate, random)
    seen = [DetectedWeight(place_m=place, sigma_m=1e-3, half_width_m=4e-3) for place in seen_m]
    return seen_weights(context, arm, throws, fit.E_m, seen, random)


def test_a_weight_that_explains_the_throw_is_to_be_declared_where_it_is_seen(tmp_path: Path) -> None:
    (fault,), warnings = found_in(tmp_path, None, [PLACE_M])
    assert warnings == []
    assert "a weight is seen 200 mm from the clamp, where none is declared" in fault.what
    assert fault.fix == "declare these places"


def test_a_declared_weight_that_hangs_elsewhere_is_named_with_its_place(tmp_path: Path) -> None:
    (fault,), warnings = found_in(tmp_path, 0.05, [PLACE_M])
    assert warnings == []
    assert "the weight declared 50 mm from the clamp is seen 200.0 ± 1.0 mm from it" in fault.what
    assert fault.fix.endswith("its place_m is 0.200")


def test_a_mark_that_weighs_little_is_called_one(tmp_path: Path) -> None:
    faults, (warning,) = found_in(tmp_path, PLACE_M, [PLACE_M, 0.06])
    assert faults == []
    assert warning.endswith("it may be a knot or a mark that weighs little")


def test_a_weight_seen_where_it_is_declared_is_no_news(tmp_path: Path) -> None:
    assert found_in(tmp_path, PLACE_M, [PLACE_M + 0.002]) == ([], [])
