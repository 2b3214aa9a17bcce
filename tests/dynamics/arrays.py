"""Simulate strings that are given as plain arrays."""

import numpy as np

from strandcast.core.strings import StringBatch
from strandcast.dynamics import simulate as simulation
from strandcast.dynamics.batch import HandPath, MeasuredPoints, StringStart


def strings_of(parameters, masses, **columns):
    """Return B strings; a column that is a number is common to all."""
    count = len(parameters)
    wide = {k: v if np.ndim(v) else np.full(count, float(v)) for k, v in columns.items()}
    own = {name: wide.pop(name) for name in ("bend_factor", "disturbances", "free_masses") if name in wide}
    return StringBatch(parameters, masses, **own).with_values(**wide)


def simulate_batch(
    model,
    parameters,
    masses,
    time_s,
    pose,
    out_s,
    start=None,
    velocity=None,
    respace=True,
    settle=False,
    **columns,
):
    """Points (B, F, n+1, 2) [m] and status (B,) of B strings."""
    strings = strings_of(parameters, masses, **columns)
    return simulation.simulate_batch(
        model, strings, HandPath(time_s, pose), out_s, StringStart(start, velocity, respace, settle)
    )


def simulate(model, parameters, masses, *path_and_start, bend_factor=None, **columns):
    """Points (F, n+1, 2) [m] and status of one string."""
    if bend_factor is not None:
        columns["bend_factor"] = np.array([bend_factor])
    points, status = simulate_batch(model, parameters[None], masses[None], *path_and_start, **columns)
    return points[0], int(status[0])


def start_shape(model, parameters, masses, pose, start=None, **columns):
    """Points 0…n (n+1, 2) [m] with which a simulation starts from a hand at `pose` (3,)."""
    time_s = np.array([0.0, 1.0])
    return simulate(model, parameters, masses, time_s, np.array([pose, pose]), time_s[:1], start, **columns)[
        0
    ][0]


def evaluate_batch(model, parameters, masses, time_s, pose, frame_s, points_m, per_metre, **options):
    """Values (B,) [m] and status (B,) of B strings."""
    hand, measured = HandPath(time_s, pose), MeasuredPoints(frame_s, points_m, per_metre)
    return simulation.evaluate_batch(model, strings_of(parameters, masses), hand, measured, **options)
