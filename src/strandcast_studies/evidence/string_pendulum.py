"""A bob on a string, filmed for two minutes: its length from ten seconds, its drag from another length.

The string is simulated as one segment with the bob at its end, so that large swings have their longer period.
A swing gives only g / length and drag / mass: the drag is per kilogram of bob, and the same for every length.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.core.strings import PARAMETERS, StringBatch
from strandcast.dynamics.batch import HandPath, StringStart
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.simulate import simulate_batch
from strandcast_pendulum.period import period_s
from strandcast_studies.evidence.figure import Figure
from strandcast_studies.evidence.solve import FreeParameter, solve

FILES = ("8047", "8048", "8049", "8050", "8051")
GRAVITY_M_S2 = 9.804  # in Toronto; affects only the scale of the lengths
FIT_S = 10.0
AMPLITUDE_AT_S = 100.0
STEP_S = 4e-3
PERIOD_TARGET_PERCENT, AMPLITUDE_TARGET_PERCENT = 0.1, 10.0

_STRETCH = 1e5  # N/m/kg: stretches by 0.1 mm
_NONE = 1e-9


@dataclass(frozen=True, eq=False)
class PendulumSwing:
    """Times (F,) from zero on [s] and angles (F,) of the bob from the vertical through the pivot [rad]."""

    time_s: Array
    angle_rad: Array

    def until(self, end_s: float) -> PendulumSwing:
        """Return the first `end_s` seconds."""
        kept = self.time_s <= end_s
        return PendulumSwing(self.time_s[kept], self.angle_rad[kept])


def read(path: Path) -> PendulumSwing:
    """Read columns t [s], x, y [m]; the pivot is the origin, y points up.

    The angle does not depend on the pictures' scale, which differs by up to 1.6 % between length and period.
    """
    table = np.genfromtxt(path, delimiter=",", names=True)
    return PendulumSwing(table["t"] - table["t"][0], np.arctan2(table["x"], -table["y"]))


def swing(state: Array, drag: Array, time_s: Array) -> Array:
    """Return the angles (F,) [rad] of the simulated bob.

    Parameters
    ----------
    state
        (4,) effective length [m], angle [rad] and angular rate [rad/s] at time 0, tilt of the camera [rad].
    drag
        (2,) C_c1 [1/s] and C_c2 [1/m] per kilogram of bob.
    time_s
        (F,) ascending times from 0 on [s].
    """
    length_m, angle, rate, tilt = state
    model = StringModel(float(length_m), 1, dt_s=STEP_S, gravity_m_s2=GRAVITY_M_S2)
    parameters = np.full(10, _NONE)
    parameters[PARAMETERS.index("k_s")] = _STRETCH
    parameters[PARAMETERS.index("c_s")] = 10.0
    parameters[PARAMETERS.index("C_c1")], parameters[PARAMETERS.index("C_c2")] = drag
    along, across = np.array([np.sin(angle), -np.cos(angle)]), np.array([np.cos(angle), np.sin(angle)])
    pivot = np.tile([0.0, 0.0, -0.5 * np.pi], (2, 1))
    bob_m = simulate_batch(
        model,
        StringBatch(parameters[None], np.ones((1, 1))),
        HandPath(np.array([0.0, float(time_s[-1]) + 1.0]), pivot),
        time_s,
        StringStart(length_m * along[None], length_m * rate * across[None]),
    )[0][0, :, 1]
    return np.asarray(np.arctan2(bob_m[:, 0], -bob_m[:, 1]) + tilt)


def fit_state(measured: PendulumSwing, drag: Array) -> Array:
    """Return the state (4,), see `swing`, that best explains a series with a given drag."""

    def residuals(candidates: Array) -> Array:
        return np.array([swing(state, drag, measured.time_s) - measured.angle_rad for state in candidates])

    return solve(residuals, _state(measured)).values


def fit_drag(measured: PendulumSwing, laws: tuple[bool, bool]) -> tuple[Array, float]:
    """Return the drag (2,) that best explains a whole series, fitted with its state, and the rms error [rad].

    Parameters
    ----------
    laws
        Which of C_c1 and C_c2 are free; the other is zero.
    """
    used = np.flatnonzero(laws)
    start = fit_state(measured.until(FIT_S), np.where(laws, 5e-3, _NONE))
    unknowns = _state(measured) + [FreeParameter(f"drag_{k}", 5e-3, 0.0, 0.1, 1e-4) for k in used]

    def residuals(candidates: Array) -> Array:
        return np.array(
            [swing(c[:4], _drag(c[4:], used), measured.time_s) - measured.angle_rad for c in candidates]
        )

    found = solve(residuals, unknowns, np.r_[start, np.full(len(used), 5e-3)])
    return _drag(found.values[4:], used), float(np.sqrt(found.sum_of_squares / len(measured.time_s)))


def amplitude_rad(time_s: Array, angle_rad: Array, at_s: float, period: float) -> float:
    """Return the amplitude of the sine fitted to three periods around `at_s` [rad]."""
    near = np.abs(time_s - at_s) <= 1.5 * period
    phase = 2.0 * np.pi / period * time_s[near]
    waves = np.column_stack([np.cos(phase), np.sin(phase), np.ones(near.sum())])
    part = np.linalg.lstsq(waves, angle_rad[near], rcond=None)[0]
    return float(np.hypot(part[0], part[1]))


def errors_percent(measured: PendulumSwing, state: Array, drag: Array) -> tuple[float, float]:
    """Return the errors of the predicted period after the fitted seconds and of the amplitude [%]."""
    rest = measured.time_s > FIT_S
    time_s, angle = measured.time_s, swing(state, drag, measured.time_s)
    truth_s, guess_s = period_s(time_s[rest], measured.angle_rad[rest]), period_s(time_s[rest], angle[rest])
    truth, guess = (amplitude_rad(time_s, a, AMPLITUDE_AT_S, truth_s) for a in (measured.angle_rad, angle))
    return 100.0 * (guess_s / truth_s - 1.0), 100.0 * (guess / truth - 1.0)


def measure(folder: Path) -> list[Figure]:
    """Return figures over all pairs of files: the drag is fitted to one, the swing of the other predicted."""
    swings = {name: read(folder / f"{name}.csv") for name in FILES}
    found = {name: fit_drag(measured, (True, True)) for name, measured in swings.items()}
    periods, amplitudes = {}, {}
    for source, (drag, _) in found.items():
        for name, measured in swings.items():
            if name != source:
                pair = f"{source} to {name}"
                state = fit_state(measured.until(FIT_S), drag)
                periods[pair], amplitudes[pair] = errors_percent(measured, state, drag)
    return [
        _worst("string_pendulum.period_after_10_s", periods, PERIOD_TARGET_PERCENT),
        _worst("string_pendulum.amplitude_at_100_s", amplitudes, AMPLITUDE_TARGET_PERCENT),
        _which_drag(swings, found),
    ]


def _worst(name: str, errors: dict[str, float], target: float) -> Figure:
    """Return the figure of the pair with the largest error, with all pairs as detail."""
    worst = max(errors, key=lambda pair: abs(errors[pair]))
    note = f"largest of {len(errors)} pairs, drag of one file used for the other: {worst}"
    return Figure(name, errors[worst], "%", target, note, {"percent": errors})


def _which_drag(swings: dict[str, PendulumSwing], both: dict[str, tuple[Array, float]]) -> Figure:
    """Return the figure of the drag laws: share of the squared one in the first swings' loss; each alone."""
    shares, detail = [], {}
    for name, measured in swings.items():
        drag, rms = both[name]
        speed = np.sqrt(GRAVITY_M_S2 * nominal_m(measured)) * np.abs(measured.until(FIT_S).angle_rad).max()
        # Mean power over a sine of speed v: C_c1 v^2 / 2 and C_c2 v^3 4 / (3 pi).
        linear, squared = drag[0] * 0.5, drag[1] * speed * 4.0 / (3.0 * np.pi)
        shares.append(squared / (linear + squared))
        detail[name] = {
            "C_c1_N_s_per_m_kg": float(drag[0]),
            "C_c2_N_s2_per_m2_kg": float(drag[1]),
            "rms_mrad_of_both": 1e3 * rms,
            "rms_mrad_of_C_c1_alone": 1e3 * fit_drag(measured, (True, False))[1],
            "rms_mrad_of_C_c2_alone": 1e3 * fit_drag(measured, (False, True))[1],
        }
    note = "share of C_c2, the air's drag on the bob, in the loss of the first swings: median of the files"
    return Figure(
        "string_pendulum.squared_drag_share", float(np.median(shares)), "1", note=note, detail=detail
    )


def nominal_m(measured: PendulumSwing) -> float:
    """Return the length whose small swings have the measured period [m]."""
    return float(GRAVITY_M_S2 * (period_s(measured.time_s, measured.angle_rad) / (2.0 * np.pi)) ** 2)


def _state(measured: PendulumSwing) -> list[FreeParameter]:
    """Return the unknowns of a state, with initial values from the first quarter of a second."""
    early, length_m = measured.until(0.25), nominal_m(measured)
    tilt = float(measured.angle_rad.mean())
    return [
        FreeParameter("length_m", length_m, 0.9 * length_m, 1.1 * length_m, 1e-5),
        FreeParameter("angle_rad", float(early.angle_rad[0]) - tilt, -1.0, 1.0, 1e-5),
        FreeParameter("rate_rad_s", float(np.polyfit(early.time_s, early.angle_rad, 1)[0]), -3.0, 3.0, 1e-5),
        FreeParameter("tilt_rad", tilt, -0.1, 0.1, 1e-5),
    ]


def _drag(values: Array, used: np.ndarray) -> Array:
    drag = np.full(2, _NONE)
    drag[used] = values
    return drag
