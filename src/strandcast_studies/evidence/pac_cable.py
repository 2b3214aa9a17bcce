"""Cables on a robot hand, recorded at 30 Hz: fitted to one motion, they predict another.

The markers are reconstructed from a curvature that is affine along the cable; this curvature also gives the
shape of the whole cable at the start.
"""

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from scipy.signal import savgol_filter

from strandcast.dynamics.parameters import Array
from strandcast_studies.evidence.cable import UNKNOWNS, Series, play, points_of
from strandcast_studies.evidence.solve import solve

FREE, DRIVEN = "free_swing", "dynamic"
PAIRS = (("black_weighted", "black_unweighted"), ("black_short_weighted", "black_short_unweighted"))
CABLES = tuple(cable for pair in PAIRS for cable in pair)
BARE_FITTING_KG = 0.03

RELEASED_FRAME = 4  # of a free swing: the end has been released by then
REST_FRAMES = 15
_SMOOTHING_FRAMES = 7  # the hand's noise of 1 mm is an acceleration of 1 m/s^2 at 30 Hz
_ALONG = 200

CABLE = ("log_stiffness", "log_damping", "curl_rad_m", "clamp_rad", "log_friction", "log_stick")


def read(folder: Path, kind: str, cable: str) -> Series:
    """Read one motion of one cable.

    Parameters
    ----------
    folder
        ``pac_cable``.
    kind
        `FREE`, from the release of the end, or `DRIVEN`.
    cable
        One of `CABLES`.
    """
    known = known_of(folder, cable)
    state = np.genfromtxt(folder / kind / f"{cable}.csv", delimiter=",", names=True)
    table = np.genfromtxt(folder / kind / f"{cable}.markers_rebuilt.csv", delimiter=",", names=True)
    raw = np.column_stack([table["x_base"], table["z_base"]])
    hand = savgol_filter(raw, _SMOOTHING_FRAMES, 2, axis=0)
    markers = np.stack([np.column_stack([table[f"x_{k}"], table[f"z_{k}"]]) for k in ("mid", "end")], axis=1)
    markers += (hand - raw)[:, None]  # they were reconstructed from the noisy hand
    first = RELEASED_FRAME if kind == FREE else 0
    curvature, rate = _start_curvature(state, first, kind)
    start, velocity = _start(curvature, rate, float(state["Phi"][first]), known["L"])
    return Series(
        cable,
        kind,
        known["L"],
        known["m_len"],
        BARE_FITTING_KG,
        table["t"][first:],
        np.column_stack([hand, -0.5 * np.pi - state["Phi"]])[first:],
        markers[first:],
        hand[first] + start,
        velocity,
    )


def known_of(folder: Path, cable: str) -> dict[str, float]:
    """Return what is known of a cable: masses ``m_len``, ``m_end`` [kg], length ``L`` [m]."""
    known: dict[str, float] = json.loads((folder / "object_parameters.json").read_text())[cable]
    return known


def weight_kg(folder: Path, cable: str) -> float:
    """Return the known mass of the weight at a cable's end [kg]."""
    return known_of(folder, cable)["m_end"] - BARE_FITTING_KG


def fit(series: Series, names: Iterable[str], weight: float) -> dict[str, float]:
    """Fit unknowns of one cable to one series by least squares of all marker positions.

    Parameters
    ----------
    series
        The measurement.
    names
        The unknowns, see `strandcast_studies.evidence.cable.UNKNOWNS`.
    weight
        Known mass of the weight at the end [kg].

    Returns
    -------
    The fitted values by name, and the weight.
    """
    unknowns = [UNKNOWNS[name] for name in names]

    def residuals(candidates: Array) -> Array:
        values = {u.name: candidates[:, k] for k, u in enumerate(unknowns)} | {"weight_kg": weight}
        return np.asarray((series.markers_m - play(series, values)).reshape(len(candidates), -1))

    found = solve(residuals, unknowns).values
    return {u.name: float(value) for u, value in zip(unknowns, found, strict=True)} | {"weight_kg": weight}


def tip_error_mm(series: Series, values: dict[str, float]) -> float:
    """Return the mean distance between the simulated and the measured end [mm]."""
    simulated = play(series, values)[0, :, 1]
    return float(1e3 * np.linalg.norm(simulated - series.markers_m[:, 1], axis=1).mean())


def trivial_mm(series: Series, other: Series) -> dict[str, float]:
    """Return mean tip errors [mm] of two predictors without a model, given another series that ends at rest.

    ``rest_held``: the end stays where it hangs below the hand's first place; ``hand_copied``: it keeps its
    place relative to the hand.
    """
    rest = other.reach_m[-REST_FRAMES:].mean(axis=0)
    held = series.markers_m[:, 1] - (series.hand_pose[0, :2] + rest)
    copied = series.reach_m - rest
    return {
        name: float(1e3 * np.linalg.norm(miss, axis=1).mean())
        for name, miss in (("rest_held", held), ("hand_copied", copied))
    }


def _start_curvature(state: np.ndarray, first: int, kind: str) -> tuple[Array, Array]:
    """Return curvature (2,) [rad per length] at frame `first` and its rate (2,) [1/s]."""
    both = np.column_stack([state["Theta0"], state["Theta1"]])
    if kind == DRIVEN:
        return both[first : first + 3].mean(axis=0), np.zeros(2)
    near = slice(max(first - 2, 0), first + 3)
    parabola = np.polynomial.polynomial.polyfit(state["ts"][near] - state["ts"][first], both[near], 2)
    return parabola[0], parabola[1]


def _start(curvature: Array, rate: Array, phi: float, length_m: float) -> tuple[Array, Array]:
    """Return points 1…n relative to the hand [m] and their velocities [m/s] from curvature and rate."""
    tick = 1e-4
    shape, later = (_points(curvature + t * rate, phi, length_m) for t in (0.0, tick))
    return shape, (later - shape) / tick


def _points(curvature: Array, phi: float, length_m: float) -> Array:
    """Return points (n, 2) of a cable at the angle phi + c0 s + c1 s^2 / 2 from straight down, s in 0…1."""
    s = (np.arange(_ALONG) + 0.5) / _ALONG
    angle = phi + curvature[0] * s + 0.5 * curvature[1] * s**2
    ends = np.cumsum(np.column_stack([-np.sin(angle), -np.cos(angle)]), axis=0) * length_m / _ALONG
    n = points_of(length_m)
    at = np.arange(1, n + 1) / n
    return np.column_stack([np.interp(at, np.arange(1, _ALONG + 1) / _ALONG, ends[:, c]) for c in range(2)])
