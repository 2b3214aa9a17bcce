"""Candidates in space as the kernels take them."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from strandcast.core.strings import CLAMP_OFFSET, FAR_OFFSET, REST_CURL, SIDES, side
from strandcast.dynamics.candidates import (
    AS_GIVEN,
    HANGING,
    SETTLED,
    Candidates,
    StartArrays,
    columns_of,
    put_coefficients,
)
from strandcast.dynamics.elements import FIXED, SPACING
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.simd import CACHED
from strandcast.dynamics.spatial.clamps import POSE
from strandcast.dynamics.spatial.rest_shape import rest_shapes
from strandcast.dynamics.spatial.step import (
    DIRECTION,
    FAR_DIRECTION,
    L0,
    REST,
    SIDE,
    SPATIAL_COEFFICIENTS,
    TORSION,
)
from strandcast.dynamics.string_state import ReadyStrings, StepSettings
from strandcast.threads import over_ranges

# Columns of a candidate in space after the plane's: relative change of the rest spacing; turns of both clamps
# and rest bend per joint, each to the left and up in the frame of the clamp's pose [rad];
# the rest bend's own turn about the string per segment [rad].
LENGTHENED, CLAMP_TURNS, FAR_TURNS, REST_BENDS, REST_TURN = (FIXED + k for k in (0, 1, 3, 5, 7))
SPATIAL_FIXED = FIXED + 8
# The unknowns among them by name, as in `strandcast.dynamics.elements`; a turn in the plane is to the left.
IN_SPACE = {
    "length_change": LENGTHENED,
    "rest_torsion_rad_m": REST_TURN,
    "clamp_offset_rad": CLAMP_TURNS,
    "rest_curl_rad_m": REST_BENDS,
} | {
    side(name, which): first + k
    for name, first in ((CLAMP_OFFSET, CLAMP_TURNS), (FAR_OFFSET, FAR_TURNS), (REST_CURL, REST_BENDS))
    for k, which in enumerate(SIDES)
}


def in_space(pose: Array) -> bool:
    """Whether poses (..., columns) are of clamps in space."""
    return bool(pose.shape[-1] != 3)


def _turned(turns: Array) -> tuple[Array, Array, Array]:
    """Return the frame of a clamp turned by angles (B, 2) to the left and up, three (B, 3) in its pose's."""
    angle = np.linalg.norm(turns, axis=1)
    size, cosine = np.sinc(angle / np.pi), np.cos(angle)
    left, up = (size[:, None] * turns).T
    # Rodrigues' formula about the axis (0, -up, left), and (1 - cos) / angle^2 = sinc(angle / 2)^2 / 2.
    bent = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    a, b = turns.T
    along = np.column_stack([cosine, left, up])
    to_left = np.column_stack([-left, 1.0 - bent * a * a, -bent * a * b])
    upward = np.column_stack([-up, -bent * a * b, 1.0 - bent * b * b])
    return along, to_left, upward


@njit(**CACHED)
def _put_all(parameters: Array, masses: Array, fixed: Array, step: float, c: Array) -> None:
    for b in range(len(masses)):
        put_coefficients(parameters[b], masses[b], fixed[b], step, c[:, b])


def ready_in_space(
    candidates: Candidates, poses: Array, start: StartArrays, settings: StepSettings
) -> tuple[ReadyStrings, NDArray[np.bool_]]:
    """Return what steps need of candidates with clamps that start at `poses` (1 or B, 9 or 18).

    And (B,) for which of them no rest shape was found to start from.
    """
    poses = np.ascontiguousarray(poses)
    strings = columns_of(candidates, SPATIAL_COEFFICIENTS)
    _put_all(candidates.parameters, candidates.masses, candidates.fixed, settings.step, strings.c)
    _put_spatial(candidates.fixed, strings.c)
    strings.d[:] = _first_segments(candidates, poses, start, settings.gravity)
    strings.v[3:] = start.velocity_m_s.reshape(-1, 1)
    lost = np.zeros(len(candidates.masses), dtype=bool)
    if start.mode in (HANGING, SETTLED):
        over_ranges(
            len(lost),
            lambda first, last: rest_shapes(
                first, last, candidates, strings.c, poses, settings, strings.d, lost
            ),
        )
    return strings, lost


def _put_spatial(fixed: Array, c: Array) -> None:
    """Write the rows of `c` (SPATIAL_COEFFICIENTS, B) that strings in the plane do not have."""
    along, left, up = _turned(fixed[:, CLAMP_TURNS : CLAMP_TURNS + 2])
    to_left, upward, torsion = fixed[:, REST_BENDS], fixed[:, REST_BENDS + 1], fixed[:, REST_TURN]
    c[L0] = fixed[:, SPACING] * (1.0 + fixed[:, LENGTHENED])
    c[DIRECTION : DIRECTION + 3] = along.T
    # A bend to the left turns about the upward axis, one upwards about the axis to the right.
    c[REST : REST + 3] = (to_left[:, None] * up - upward[:, None] * left).T
    c[SIDE : SIDE + 3] = left.T
    c[TORSION], c[TORSION + 1] = np.cos(torsion), np.sin(torsion)
    c[FAR_DIRECTION : FAR_DIRECTION + 3] = _turned(fixed[:, FAR_TURNS : FAR_TURNS + 2])[0].T


def _first_segments(candidates: Candidates, poses: Array, start: StartArrays, gravity: float) -> Array:
    """Return the segments (3n, B) [m] at the start, or from where to seek the rest shape."""
    count, n = candidates.masses.shape
    l0 = candidates.fixed[:, SPACING] * (1.0 + candidates.fixed[:, LENGTHENED])
    two_ends = poses.shape[1] > POSE
    points = start.points_m
    if not len(points):
        points = _hanging_between(poses, l0 * n, n) if two_ends else _hanging_from(poses, l0, n)
    first = np.broadcast_to(poses[:, None, :3], (count, 1, 3))
    d = np.diff(np.concatenate([first, np.broadcast_to(points, (count, n, 3))], axis=1), axis=1)
    if two_ends:
        d = d + (poses[:, None, POSE : POSE + 3] - first - d.sum(axis=1, keepdims=True)) / n
    elif start.mode != AS_GIVEN:
        u = d / np.linalg.norm(d, axis=2, keepdims=True)
        below = np.cumsum(candidates.masses[:, ::-1], axis=1)[:, ::-1] * gravity
        length_m = l0[:, None] - below * u[..., 2] / candidates.parameters[:, :1]
        d = np.maximum(length_m, 0.1 * l0[:, None])[..., None] * u
    return np.asarray(d.reshape(count, 3 * n).T)


def _hanging_from(poses: Array, l0: Array, n: int) -> Array:
    """Return points (B, n, 3) of strings that leave one clamp in its direction and end downwards."""
    share = (np.arange(1, n + 1) / n)[:, None]
    u = (1.0 - share) * poses[:, None, 3:6] + share * [0.0, 0.0, -1.0] + 1e-3 * poses[:, None, 6:9]
    u /= np.linalg.norm(u, axis=2, keepdims=True)
    return np.asarray(poses[:, None, :3] + l0[:, None, None] * np.cumsum(u, axis=1))


def _hanging_between(poses: Array, length_m: Array, n: int) -> Array:
    """Return points (B, n, 3) that sag between two clamps like a parabola of about the string's length."""
    start, end = poses[:, None, :3], poses[:, None, POSE : POSE + 3]
    span = np.linalg.norm(end - start, axis=2)[:, 0]
    sag = np.sqrt(np.maximum(0.375 * span * (length_m - span), (0.01 * length_m) ** 2))
    share = (np.arange(1, n + 1) / n)[:, None]
    down = (sag[:, None, None] * (4.0 * share * (1.0 - share))) * [0.0, 0.0, -1.0]
    return np.asarray(start + share * (end - start) + down)
