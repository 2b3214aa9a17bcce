"""Error against step, over the corners of Table 2 and random draws of the ranges."""

import numpy as np
import pytest
from arrays import simulate_batch
from proofs_dynamics import hand_path

from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import RANGES, ensemble, random_strings
from strandcast.dynamics.simulate import OK

POINTS, LENGTH_M, DRAWS = 10, 0.3, 48
HAND_S = np.arange(0.0, 0.4001, 1e-3)
OUT_S = np.linspace(0.0, 0.4, 41)
STEPS_S = (1e-3, 5e-4, 2.5e-4)
FINEST_S = 1 / 64e3


def corners() -> tuple[np.ndarray, np.ndarray]:
    """Table 2's middle, each parameter at either end, all at one end: (23, 10); their masses (23, n)."""
    low, high = RANGES["paper"].T
    middle = np.sqrt(low * high)
    rows = [middle, low, high]
    for i in range(10):
        rows += [np.where(np.arange(10) == i, end, middle) for end in (low, high)]
    return np.array(rows), tip_weighted(np.full(23, 5.0))


def tip_weighted(weights: np.ndarray) -> np.ndarray:
    masses = np.ones((len(weights), POINTS))
    masses[:, -1] = np.maximum(weights, 1.0)
    return masses


def strings(name: str) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    if name == "corners":
        return corners()
    if name == "plausible":
        drawn = ensemble(DRAWS, LENGTH_M, POINTS, 1, rng)
    else:
        drawn = random_strings(DRAWS, 1, rng, name)
    return drawn.parameters, tip_weighted(drawn.weight_masses[:, 0])


def errors_mm(parameters: np.ndarray, masses: np.ndarray) -> np.ndarray:
    """RMS distance of each well-posed string from itself at the finest step: (steps, strings)."""
    simulated, bad = {}, np.zeros(len(parameters), dtype=bool)
    for dt_s in (*STEPS_S, FINEST_S):
        model = StringModel(LENGTH_M, POINTS, dt_s=dt_s)
        simulated[dt_s], status = simulate_batch(model, parameters, masses, HAND_S, hand_path(HAND_S), OUT_S)
        if dt_s == FINEST_S:
            length = np.linalg.norm(np.diff(simulated[dt_s], axis=2), axis=3) / model.spacing_m
            bad = (status != OK) | (length.min((1, 2)) < 0.3) | (length.max((1, 2)) > 3.0)
    apart = np.array([simulated[dt_s] - simulated[FINEST_S] for dt_s in STEPS_S])[:, ~bad]
    return 1e3 * np.sqrt((apart**2).sum(-1).mean((2, 3)))


# Table 2's strings converge with the square of the step. Cords too stiff for the step are damped in
# proportion to it: less than a tenth of a millimetre at 1 ms, which is what they get here.
@pytest.mark.parametrize(
    ("name", "median_mm", "worst_tenth_mm", "order"),
    [
        ("corners", 1e-3, 1e-3, 1.9),
        ("paper", 1e-3, 2e-3, 1.9),
        ("plausible", 0.08, 0.15, 0.5),
        ("wide", 0.02, 1.0, 1.5),
    ],
)
def test_error_falls_with_the_step(name, median_mm, worst_tenth_mm, order):
    parameters, masses = strings(name)
    errors = errors_mm(parameters, masses)
    assert errors.shape[1] > 0.75 * len(parameters)
    assert np.median(errors[0]) < median_mm
    assert np.quantile(errors[0], 0.9) < worst_tenth_mm
    assert np.median(np.log2(errors[0] / errors[2])) / 2 > order
