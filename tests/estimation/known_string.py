"""A known short string with one weight, thrown on a smooth path and observed with noise."""

import numpy as np

from strandcast.core.strings import PARAMETERS, StringBatch
from strandcast.dynamics.batch import HandPath
from strandcast.dynamics.masses import mass_layout, point_masses
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.simulate import OK, simulate_batch
from strandcast.estimation.fit_objective import FitObjective
from strandcast.estimation.measured import Throw, prepare
from strandcast.estimation.unknowns import WIDENED, space_of

MODEL = StringModel(length_m=0.24, points=6)
LAYOUT = mass_layout(0.24, 6, [0.2])
TRUTH = np.array([2e7, 20.0, 0.8, 0.01, 0.5, 0.005, 0.01, 0.2, 2.0, 0.02])
MASS = 60.0
NOISE_M = 0.0007
TIME_S = np.arange(0.0, 0.7, 0.004)


def hand_path(strength):
    s = np.clip((TIME_S - 0.1) / 0.4, 0.0, 1.0)
    ease = s**3 * (10 - 15 * s + 6 * s**2)
    return np.column_stack(
        [0.5 * strength * ease, 0.3 * np.sin(np.pi * ease) * strength, -np.pi / 2 + 2.0 * strength * ease]
    )


def known_string(stiffer=1.0):
    """Return the string, or one that bends less and swings down as fast."""
    parameters = TRUTH * np.where(np.isin(PARAMETERS, WIDENED), stiffer, 1.0)
    masses = np.array([[MASS]])
    return StringBatch(parameters[None], point_masses(LAYOUT, masses), free_masses=masses)


def simulated(string, pose):
    """Points (F, n+1, 2) [m] of one string."""
    points, status = simulate_batch(MODEL, string, HandPath(TIME_S, pose), TIME_S)
    assert status[0] == OK
    return points[0]


def observed_throw(strength, seed=0, noise=NOISE_M, stiffer=1.0):
    pose = hand_path(strength)
    points = simulated(known_string(stiffer), pose)
    points = points + noise * np.random.default_rng(seed).standard_normal(points.shape)
    return Throw(TIME_S, points, TIME_S, pose, TIME_S < 0.55)


def objective_of(throws, settings, layout=LAYOUT, model=MODEL, plain_mass=None):
    prepared = tuple(prepare(throw, model.places_m()).fitted() for throw in throws)
    space = space_of(settings, layout, plain_mass=plain_mass)
    shares = np.full(len(prepared), 1.0 / len(prepared))
    return FitObjective(model, space, prepared, shares, settings.evaluation, False)
