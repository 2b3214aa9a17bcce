"""A clamped cable of known mass as a string with stiffness, damping, dry friction, curl and an end weight.

SI units of the real cable, with a nominal point mass of 1 kg. Each end of the chain carries half a segment of
cable, and the clamp is as stiff as half a segment, so that neither depends on the number of points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from strandcast.core.strings import PARAMETERS, StringBatch
from strandcast.dynamics.batch import HandPath, StringStart
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.simulate import simulate_batch
from strandcast_studies.evidence.solve import FreeParameter

POINT_SPACING_M = 0.03
STEP_S = 2e-3
_STRETCH_N = 1e4  # force per strain: the cable stretches by half a millimetre; chosen
_AIR = 0.013  # N s^2/m^2 per metre: half air density, drag coefficient 1.1, 20 mm of diameter

UNKNOWNS = {
    "log_stiffness": FreeParameter("log_stiffness", float(np.log(0.13)), -6.0, 1.0, 0.01),
    "log_damping": FreeParameter("log_damping", float(np.log(0.005)), -12.0, -1.0, 0.02),
    "log_friction": FreeParameter("log_friction", float(np.log(0.03)), -9.0, 0.0, 0.02),
    "log_stick": FreeParameter("log_stick", 0.0, float(np.log(0.02)), float(np.log(50.0)), 0.02),
    "curl_rad_m": FreeParameter("curl_rad_m", -1.0, -15.0, 15.0, 0.02),
    "clamp_rad": FreeParameter("clamp_rad", 0.0, -0.4, 0.4, 0.003),
    "log_clamp": FreeParameter("log_clamp", float(np.log(2.0)), -3.0, 4.0, 0.03),
    "delay_s": FreeParameter("delay_s", 0.0, -0.1, 0.1, 0.002),
    "weight_kg": FreeParameter("weight_kg", 0.15, 0.0, 1.0, 0.002),
}
"""Stiffness [N m^2]; damping [N m^2 s]; moment of dry friction [N m], without which a swing decays
exponentially and never stops; bend per length over which friction builds up [rad/m], without which it does
not stick; rest curl; turn of the clamp and its stiffness relative to a segment's; delay of the hand's times
relative to the markers'; mass of the weight."""

Values = Mapping[str, Array | float]


@dataclass(frozen=True, eq=False)
class Series:
    """One recorded motion of one cable."""

    cable: str
    kind: str  # of motion
    length_m: float  # free length
    cable_kg: float
    fitting_kg: float  # at its end
    time_s: Array  # (F,)
    hand_pose: Array  # (F, 3) x, y [m] and the direction in which the hand points the cable [rad]
    markers_m: Array  # (F, 2, 2) positions of the middle and the end
    start_m: Array  # (n, 2) points 1…n in the first frame
    start_velocity_m_s: Array  # (n, 2)

    @property
    def points(self) -> int:
        """Number n of points."""
        return len(self.start_m)

    @property
    def reach_m(self) -> Array:
        """Vectors (F, 2) from the hand to the end [m]."""
        return np.asarray(self.markers_m[:, 1] - self.hand_pose[:, :2])

    def until(self, duration_s: float) -> Series:
        """Return the first `duration_s` seconds."""
        kept = self.time_s - self.time_s[0] <= duration_s
        moving = {name: getattr(self, name)[kept] for name in ("time_s", "hand_pose", "markers_m")}
        return replace(self, **moving)


def points_of(length_m: float) -> int:
    """Return the number of points of a cable: even, so that one is at its middle."""
    return 2 * round(length_m / (2.0 * POINT_SPACING_M))


def play(series: Series, values: Values) -> Array:
    """Simulate candidates on the hand's path of a series.

    Parameters
    ----------
    series
        Start, hand path and times.
    values
        Unknowns by name, (B,) or shared; effects that are not given are absent.

    Returns
    -------
    (B, F, 2, 2) positions of the middle and the end [m]; NaN where the simulation failed.
    """
    batch = max(np.size(value) for value in values.values())
    given = {name: np.broadcast_to(np.asarray(value, dtype=float), batch) for name, value in values.items()}
    none = np.zeros(batch)
    n = series.points
    model = StringModel(series.length_m, n, reading="sign", dt_s=STEP_S)
    strings = StringBatch(
        _parameters(given, series.length_m / n), _masses(series, given.get("weight_kg", none))
    ).with_values(
        rest_curl_rad_m=given.get("curl_rad_m", none),
        clamp_offset_rad=given.get("clamp_rad", none),
        bend_friction=np.exp(given["log_friction"]) if "log_friction" in given else none,
        friction_stick_rad_m=np.exp(given["log_stick"]) if "log_stick" in given else none,
    )
    pose = _late(series, given["delay_s"]) if "delay_s" in given else series.hand_pose
    start = StringStart(series.start_m, series.start_velocity_m_s)
    positions, _ = simulate_batch(model, strings, HandPath(series.time_s, pose), series.time_s, start)
    return np.asarray(positions[:, :, [n // 2, n]])


def _parameters(given: dict[str, Array], spacing_m: float) -> Array:
    """Return the parameters (B, 10) in the model's order."""
    bending = np.exp(given["log_stiffness"]) / spacing_m
    damping = np.exp(given["log_damping"]) / spacing_m
    clamp = np.exp(given["log_clamp"]) if "log_clamp" in given else 2.0
    columns: dict[str, Array | float] = {
        "k_s": _STRETCH_N / spacing_m,
        "c_s": 5.0,
        "k_h": bending,
        "k_sh": bending,
        "c_h": damping,
        "c_sh": damping,
        "C_c1": 1e-6,
        "C_c2": _AIR * spacing_m,
        "k_ph": clamp * bending,
        "c_ph": 2.0 * damping,
    }
    return np.column_stack([np.broadcast_to(columns[name], len(bending)) for name in PARAMETERS])


def _masses(series: Series, weight_kg: Array) -> Array:
    """Return masses (B, n) [kg]."""
    masses = np.full((len(weight_kg), series.points), series.cable_kg / series.points)
    masses[:, -1] = 0.5 * series.cable_kg / series.points + series.fitting_kg + weight_kg
    return masses


def _late(series: Series, delay_s: Array) -> Array:
    """Return hand poses (B, F, 3) delayed by `delay_s`."""
    time_s = series.time_s - delay_s[:, None]
    return np.stack([np.interp(time_s, series.time_s, series.hand_pose[:, c]) for c in range(3)], axis=2)
