"""A bob on a string, filmed for two minutes: the length from ten seconds, the drag from another length.

The string is simulated as one segment with the bob on it, so that large swings keep their longer period. Only
g / length and drag / mass can be known from a swing: the drag found is per kilogram of bob, and the same bob
carries it to every length.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.evidence.figure import Figure
from strandcast.evidence.solve import Unknown, solve
from strandcast.string.model import StringModel
from strandcast.string.parameters import PARAMETERS, Array
from strandcast.string.simulate import simulate

FILES = ("8047", "8048", "8049", "8050", "8051")
GRAVITY_M_S2 = 9.804  # of Toronto; it scales the lengths and nothing else
FIT_S = 10.0
AMPLITUDE_AT_S = 100.0
STEP_S = 4e-3
PERIOD_TARGET_PERCENT, AMPLITUDE_TARGET_PERCENT = 0.1, 10.0

_STRETCH = 1e5  # N/m/kg: stretches by 0.1 mm
_NONE = 1e-9


@dataclass(frozen=True, eq=False)
class Swing:
    """Times (F,) from zero on [s] and angles (F,) of the bob from the vertical through the pivot [rad]."""

    time_s: Array
    angle_rad: Array

    def until(self, end_s: float) -> Swing:
        """Return its first `end_s` seconds."""
        kept = self.time_s <= end_s
        return Swing(self.time_s[kept], self.angle_rad[kept])


def read(path: Path) -> Swing:
    """Read columns t [s], x, y [m]; the pivot is the origin, y points up.

    The angle is free of the pictures' scale, which is off by up to 1.6 % between length and period.
    """
    table = np.genfromtxt(path, delimiter=",", names=True)
    return Swing(table["t"] - table["t"][0], np.arctan2(table["x"], -table["y"]))


def swing(state: Array, drag: Array, time_s: Array) -> Array:
    """Angles (F,) [rad] of the simulated bob.

    Parameters
    ----------
    state
        (4,) effective length [m], angle [rad] and angular rate [rad/s] at time 0, tilt of the camera [rad].
    drag
        (2,) C_c1 [1/s] and C_c2 [1/m] per kilogram of bob.
    time_s
        (F,) rising times from 0 on [s].
    """
    length_m, angle, rate, tilt = state
    model = StringModel(float(length_m), 1, dt_s=STEP_S, gravity_m_s2=GRAVITY_M_S2)
    parameters = np.full(10, _NONE)
    parameters[PARAMETERS.index("k_s")] = _STRETCH
    parameters[PARAMETERS.index("c_s")] = 10.0
    parameters[PARAMETERS.index("C_c1")], parameters[PARAMETERS.index("C_c2")] = drag
    along, across = np.array([np.sin(angle), -np.cos(angle)]), np.array([np.cos(angle), np.sin(angle)])
    pivot = np.tile([0.0, 0.0, -0.5 * np.pi], (2, 1))
    positions, _ = simulate(
        model,
        parameters,
        np.ones(1),
        np.array([0.0, float(time_s[-1]) + 1.0]),
        pivot,
        time_s,
        length_m * along[None],
        length_m * rate * across[None],
    )
    return np.asarray(np.arctan2(positions[:, 1, 0], -positions[:, 1, 1]) + tilt)


def fit_state(seen: Swing, drag: Array) -> Array:
    """State (4,), see `swing`, that explains a series under a given drag."""

    def residuals(candidates: Array) -> Array:
        return np.array([swing(state, drag, seen.time_s) - seen.angle_rad for state in candidates])

    return solve(residuals, _state(seen)).values


def fit_drag(seen: Swing, laws: tuple[bool, bool]) -> tuple[Array, float]:
    """Drag (2,) that explains the whole of a series, its state fitted along; and the residual's rms [rad].

    Parameters
    ----------
    laws
        Which of C_c1 and C_c2 are free; the other is zero.
    """
    used = np.flatnonzero(laws)
    start = fit_state(seen.until(FIT_S), np.where(laws, 5e-3, _NONE))
    unknowns = _state(seen) + [Unknown(f"drag_{k}", 5e-3, 0.0, 0.1, 1e-4) for k in used]

    def residuals(candidates: Array) -> Array:
        return np.array([swing(c[:4], _drag(c[4:], used), seen.time_s) - seen.angle_rad for c in candidates])

    found = solve(residuals, unknowns, np.r_[start, np.full(len(used), 5e-3)])
    return _drag(found.values[4:], used), float(np.sqrt(found.sum_of_squares / len(seen.time_s)))


def period_s(time_s: Array, angle_rad: Array) -> float:
    """Mean period between the first and last rising passage through the middle [s]."""
    middle = angle_rad - angle_rad.mean()
    rising = np.flatnonzero((middle[:-1] < 0) & (middle[1:] >= 0))
    share = middle[rising] / (middle[rising] - middle[rising + 1])
    passage_s = time_s[rising] + share * (time_s[rising + 1] - time_s[rising])
    return float(np.polyfit(np.arange(len(passage_s)), passage_s, 1)[0])


def amplitude_rad(time_s: Array, angle_rad: Array, at_s: float, period: float) -> float:
    """Amplitude of the sine through three periods around `at_s` [rad]."""
    near = np.abs(time_s - at_s) <= 1.5 * period
    phase = 2.0 * np.pi / period * time_s[near]
    waves = np.column_stack([np.cos(phase), np.sin(phase), np.ones(near.sum())])
    part = np.linalg.lstsq(waves, angle_rad[near], rcond=None)[0]
    return float(np.hypot(part[0], part[1]))


def errors_percent(seen: Swing, state: Array, drag: Array) -> tuple[float, float]:
    """Errors of the predicted period after the fit's seconds and of the amplitude at 100 s [%]."""
    rest = seen.time_s > FIT_S
    time_s, angle = seen.time_s, swing(state, drag, seen.time_s)
    truth_s, guess_s = period_s(time_s[rest], seen.angle_rad[rest]), period_s(time_s[rest], angle[rest])
    truth, guess = (amplitude_rad(time_s, a, AMPLITUDE_AT_S, truth_s) for a in (seen.angle_rad, angle))
    return 100.0 * (guess_s / truth_s - 1.0), 100.0 * (guess / truth - 1.0)


def measure(folder: Path) -> list[Figure]:
    """Figures over all pairs of files: the drag fitted on one, the swing predicted of the other."""
    swings = {name: read(folder / f"{name}.csv") for name in FILES}
    found = {name: fit_drag(seen, (True, True)) for name, seen in swings.items()}
    periods, amplitudes = {}, {}
    for source, (drag, _) in found.items():
        for name, seen in swings.items():
            if name != source:
                pair = f"{source} to {name}"
                state = fit_state(seen.until(FIT_S), drag)
                periods[pair], amplitudes[pair] = errors_percent(seen, state, drag)
    return [
        _worst("string_pendulum.period_after_10_s", periods, PERIOD_TARGET_PERCENT),
        _worst("string_pendulum.amplitude_at_100_s", amplitudes, AMPLITUDE_TARGET_PERCENT),
        _which_drag(swings, found),
    ]


def _worst(name: str, errors: dict[str, float], target: float) -> Figure:
    """Figure of the pair with the largest error, all pairs beside it."""
    worst = max(errors, key=lambda pair: abs(errors[pair]))
    note = f"largest of {len(errors)} pairs, drag of one file carried to the other: {worst}"
    return Figure(name, errors[worst], "%", target, note, {"percent": errors})


def _which_drag(swings: dict[str, Swing], both: dict[str, tuple[Array, float]]) -> Figure:
    """Figure of the laws of drag: share of the squared one in the first swings' loss; each law alone."""
    shares, detail = [], {}
    for name, seen in swings.items():
        drag, rms = both[name]
        speed = np.sqrt(GRAVITY_M_S2 * nominal_m(seen)) * np.abs(seen.until(FIT_S).angle_rad).max()
        # Mean power over a sine of speed v: C_c1 v^2 / 2 and C_c2 v^3 4 / (3 pi).
        linear, squared = drag[0] * 0.5, drag[1] * speed * 4.0 / (3.0 * np.pi)
        shares.append(squared / (linear + squared))
        detail[name] = {
            "C_c1_N_s_per_m_kg": float(drag[0]),
            "C_c2_N_s2_per_m2_kg": float(drag[1]),
            "rms_mrad_of_both": 1e3 * rms,
            "rms_mrad_of_C_c1_alone": 1e3 * fit_drag(seen, (True, False))[1],
            "rms_mrad_of_C_c2_alone": 1e3 * fit_drag(seen, (False, True))[1],
        }
    note = "share of C_c2, the air's drag on the bob, in the loss of the first swings: median of the files"
    return Figure(
        "string_pendulum.squared_drag_share", float(np.median(shares)), "1", note=note, detail=detail
    )


def nominal_m(seen: Swing) -> float:
    """Length whose small swings have the period seen [m]."""
    return float(GRAVITY_M_S2 * (period_s(seen.time_s, seen.angle_rad) / (2.0 * np.pi)) ** 2)


def _state(seen: Swing) -> list[Unknown]:
    """Unknowns of a state, started from the first quarter of a second."""
    early, length_m = seen.until(0.25), nominal_m(seen)
    tilt = float(seen.angle_rad.mean())
    return [
        Unknown("length_m", length_m, 0.9 * length_m, 1.1 * length_m, 1e-5),
        Unknown("angle_rad", float(early.angle_rad[0]) - tilt, -1.0, 1.0, 1e-5),
        Unknown("rate_rad_s", float(np.polyfit(early.time_s, early.angle_rad, 1)[0]), -3.0, 3.0, 1e-5),
        Unknown("tilt_rad", tilt, -0.1, 0.1, 1e-5),
    ]


def _drag(values: Array, used: np.ndarray) -> Array:
    drag = np.full(2, _NONE)
    drag[used] = values
    return drag
