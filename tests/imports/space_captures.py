"""Captures in space as files: motions of a known string from our own simulator, in millimetres, y up."""

from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from strandcast.dynamics.batch import HandPath
from strandcast.dynamics.simulate import simulate_batch
from strandcast.estimation.cable_series import end_pose
from strandcast.estimation.cable_space import space_of_cable
from strandcast.records.alignment import EndPath

LENGTH_M = 0.8
PLACES_M = (0.15, 0.33, 0.55, 0.8)
TRUTH = {
    "bending_length": 0.15,
    "damping_s": 0.05,
    "air": 0.2,
    "clamp_stiffness": 1.0,
    "length_change": -0.01,
    "clamp_left_rad": 0.05,
    "clamp_up_rad": -0.1,
}
BODY = Rotation.from_euler("xyz", [0.4, -0.3, 1.0])  # of the tracked body against the direction of the string
Y_UP = np.array(
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
)  # x, y, z with z up to x, y, z with y up
LEAVES = BODY.inv().apply(Y_UP @ [0.0, 0.0, -1.0])


def columns(phase: float, seconds: float = 2.5, rate_hz: float = 50.0, two_ends: bool = False):
    """Return the columns of a capture by name: time, bodies as poses and as two points, markers."""
    time_s = np.arange(0.0, seconds, 1.0 / rate_hz)
    eased = np.minimum(time_s / 0.4, 1.0) ** 2
    ends, named = [], {"t": time_s}
    for name, place, lag in (("hand", (0.0, 0.0, 1.0), 0.0), ("far", (0.45, 0.1, 1.0), 0.9))[: 1 + two_ends]:
        way = [np.sin(k * time_s + phase + lag) - np.sin(phase + lag) for k in (4.1, 2.9, 5.3)]
        place_m = place + 0.12 * (eased * np.array(way)).T
        turn = Rotation.from_rotvec(np.outer(0.5 * eased * np.sin(3.0 * time_s + phase), [0.5, -0.6, 0.3]))
        down, side = turn.apply([0.0, 0.0, -1.0]), turn.apply([1.0, 0.0, 0.0])
        ends.append(EndPath(place_m, down, side))
        in_file = Rotation.from_matrix(Y_UP) * turn * Rotation.from_matrix(Y_UP).inv() * BODY
        named |= triple(f"{name}", place_m) | triple(f"{name}_behind", place_m - 0.03 * down)
        named |= {
            f"{name}_q{axis}": in_file.as_quat(scalar_first=True)[:, k] for k, axis in enumerate("wxyz")
        }
    model, space = space_of_cable(LENGTH_M, two_ends)
    strings = space.strings(space.exponents(np.array([TRUTH.get(each, 0.0) for each in space.names])))
    pose = np.hstack([end_pose(end, "measured") for end in ends])
    points, _ = simulate_batch(model, strings, HandPath(time_s, pose), time_s)
    at = CubicSpline(np.linspace(0.0, 1.0, model.points + 1), points[0], axis=1)(
        np.array(PLACES_M) / LENGTH_M
    )
    at += np.random.default_rng(int(100 * phase)).normal(0.0, 3e-4, at.shape)
    for k in range(len(PLACES_M)):
        named |= triple(f"m{k + 1}", at[:, k])
    return named


def triple(name: str, path_m: np.ndarray) -> dict[str, np.ndarray]:
    """Return the three columns of a path [m] with z up, in millimetres with y up."""
    return {f"{name}.{axis}": 1e3 * (path_m @ Y_UP.T)[:, k] for k, axis in enumerate("xyz")}


def write_csv(path: Path, named: dict[str, np.ndarray]) -> Path:
    """Write columns as CSV, NaN as an empty cell."""
    rows = zip(*named.values(), strict=True)
    cells = [",".join("" if np.isnan(value) else f"{value:.6f}" for value in row) for row in rows]
    path.write_text("\n".join([",".join(named), *cells]) + "\n")
    return path


def mapping_data(pose: bool = True, two_ends: bool = False, **more) -> dict:
    """Return a mapping of these columns as plain data."""
    bodies = {}
    for name in ("hand", "far")[: 1 + two_ends]:
        bodies[name] = {"position": [name]} | (
            {"quaternion": [f"{name}_q{axis}" for axis in "wxyz"], "leaves": LEAVES.tolist()}
            if pose
            else {"behind": [f"{name}_behind"]}
        )
    markers = [{"place_m": place, "position": [f"m{k + 1}"]} for k, place in enumerate(PLACES_M)]
    return {
        **{"time": "t", "time_unit": "s", "up": "y", "length_unit": "mm", "markers": markers},
        **bodies,
        **more,
    }
