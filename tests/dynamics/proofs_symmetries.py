"""Proofs by symmetry: what may not change the motion, and what must change it in a known way."""

import numpy as np
from arrays import simulate
from proof import Options, along, largest, parameters, proof
from proofs_dynamics import MASSES, hand_path

from strandcast.dynamics.model import READINGS, StringModel

STRING = parameters(
    k_s=2e4, c_s=5.0, k_h=0.5, c_h=0.02, k_sh=0.2, c_sh=0.01, C_c1=0.1, C_c2=0.3, k_ph=2.0, c_ph=0.02
)
SWAPPED = STRING[[0, 1, 4, 5, 2, 3, 6, 7, 8, 9]]
TIME_S = np.arange(0.0, 0.4001, 1e-3)
POSE = hand_path(TIME_S)
OUT_S = np.linspace(0.0, 0.4, 41)
START = along(np.array([-1.2, -1.5, -1.1, -1.4, -1.8]), 0.04)


@proof("mm", lfcn=1e-6, lfcn_f32=0.05)
def gauge(options: Options) -> float:
    """Scaling all masses and coefficients by one factor changes nothing."""
    apart = []
    for reading in READINGS:
        model = StringModel(0.2, 5, reading=reading, **options)
        one, _ = simulate(model, STRING, MASSES, TIME_S, POSE, OUT_S)
        seven, _ = simulate(model, 7 * STRING, 7 * MASSES, TIME_S, POSE, OUT_S)
        apart.append(seven - one)
    return 1e3 * largest(*apart)


@proof("mm", lfcn=1e-6, lfcn_f32=0.05)
def mirror(options: Options) -> float:
    """A mirrored hand gives the mirrored string; for `sign`, with h and sh swapped; a curl turns about."""
    apart = []
    mirrored = POSE * [-1.0, 1.0, -1.0] + [0.0, 0.0, np.pi]
    for reading in READINGS:
        swapped = SWAPPED if reading == "sign" else STRING
        model = StringModel(0.2, 5, reading=reading, **options)
        bent = {"rest_curl_rad_m": 3.0, "clamp_offset_rad": 0.3}
        other = {name: -value for name, value in bent.items()}
        left, _ = simulate(model, STRING, MASSES, TIME_S, POSE, OUT_S, **bent)
        right, _ = simulate(model, swapped, MASSES, TIME_S, mirrored, OUT_S, **other)
        apart.append(right * [-1.0, 1.0] - left)
    return 1e3 * largest(*apart)


@proof("mm", lfcn=1e-6, lfcn_f32=0.05)
def turned_frame(options: Options) -> float:
    """Without gravity, turning and moving the frame turns and moves the motion; over half a turn, too."""
    apart = []
    for reading in ("rate", "sign"):
        model = StringModel(0.2, 5, reading=reading, gravity_m_s2=0.0, **options)
        fixed = {"rest_curl_rad_m": 2.0, "respace": False}
        plain, _ = simulate(model, STRING, MASSES, TIME_S, POSE, OUT_S, POSE[0, :2] + START, **fixed)
        for angle in (1.0, 4.0, -7.5):
            turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
            origin = np.array([0.4, -0.3])
            pose = np.column_stack([POSE[:, :2] @ turn + origin, POSE[:, 2] + angle])
            start = (POSE[0, :2] + START) @ turn + origin
            simulated, _ = simulate(model, STRING, MASSES, TIME_S, pose, OUT_S, start, **fixed)
            apart.append(simulated - (plain @ turn + origin))
    return 1e3 * largest(*apart)


@proof("mm", lfcn=1e-6, lfcn_f32=0.1)
def moving_frame(options: Options) -> float:
    """Without air, an observer that moves along at constant speed sees the same motion."""
    model = StringModel(0.2, 5, **options)
    p = STRING.copy()
    p[6:8] = 0.0
    wind = np.array([0.8, -0.5])
    moving = POSE + np.column_stack([TIME_S[:, None] * wind, np.zeros_like(TIME_S)])
    start = POSE[0, :2] + START
    slow, _ = simulate(model, p, MASSES, TIME_S, POSE, OUT_S, start, respace=False)
    fast, _ = simulate(model, p, MASSES, TIME_S, moving, OUT_S, start, np.tile(wind, (5, 1)), respace=False)
    return 1e3 * largest(fast - slow - (OUT_S[:, None] * wind)[:, None])
