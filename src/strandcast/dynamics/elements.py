"""The elements of the string: a stretching segment, a bending joint, air drag, and the choice of h or sh.

Small numba functions of values: plain numbers, or lanes (`strandcast.dynamics.simd`) that hold one number per
candidate. Coefficients are rows of an array.
"""

import math
from typing import Any

from numba import njit

from strandcast.dynamics.simd import (
    INLINED,
    inverse,
    inverse_root,
    is_double,
    load,
    maximum,
    minimum,
    select,
    splat,
    store,
)

RATE_READING, SIGN_READING, STRAIN_READING = range(3)
SLIP_RAD_S = 0.05  # rate of bending below which dry friction acts like a damper (chosen)

# Rows of each candidate's coefficients beside its masses. The h parameters are stored as differences to the
# sh ones; FLOOR is what the averaging of a spring needs to stay stable (`strandcast.dynamics.step`).
COEFFICIENTS = 17
K_S, C_S, K_SH, K_MORE, C_SH, C_MORE, DRAG_1, DRAG_2, K_PH, C_PH, *_OTHERS = range(COEFFICIENTS)
REST_BEND, CLAMP_OFFSET, FLOOR, FRICTION, ALONG, STICKING, PER_STICK = _OTHERS

# Columns of each candidate's numbers beside parameters, masses and bend factors: rest spacing [m], rest bend
# per joint [rad], clamp offset [rad], gravity [m/s^2], half-width of the switch, dry friction of a joint
# [N m/kg], drag along the string over that across it (0: the same in all directions, as in Table 1), turn of
# the start about the hand [rad], its rate [rad/s], and bend of a joint over which its dry friction builds up
# [rad] (0: it acts like a damper at small rates).
FIXED = 10
SPACING, BEND_AT_REST, CLAMP_TURN, GRAVITY, HALF_WIDTH, DRY, DRAG_ALONG, SWAY, SWAY_RATE, STICK = range(FIXED)
# The unknowns among them by name; those per length of the string are per segment here.
COLUMN_OF = {"bend_friction": DRY, "drag_along": DRAG_ALONG, "friction_stick_rad_m": STICK}
IN_PLANE = {"rest_curl_rad_m": BEND_AT_REST, "clamp_offset_rad": CLAMP_TURN}


@njit(**INLINED)
def ramp(switch: Any, per_width: float) -> Any:
    """Position of the switch between sh (0, at -1 / per_width and below) and h (1)."""
    return minimum(maximum((0.5 * per_width) * switch + 0.5, 0.0), 1.0)


@njit(**INLINED)
def blend(t: Any) -> Any:
    """Share of the h parameters, smooth in `ramp`."""
    return t * t * (3.0 - 2.0 * t)


@njit(**INLINED)
def segment(spec: Any, dx: Any, dy: Any) -> tuple[Any, Any, Any, Any]:
    """Return unit vector, length and 1 / length of a segment (dx, dy)."""
    squared = dx * dx + dy * dy
    per_length = inverse_root(spec, squared)
    return dx * per_length, dy * per_length, squared * per_length, per_length


@njit(**INLINED)
def half_angle_ratio(spec: Any, s: Any) -> Any:
    """Twice the arc tangent of t over t, of s = t^2 up to 1, by Remez' exchange (least relative error)."""
    s2 = s * s
    if is_double(spec):
        s4 = s2 * s2
        low = (1.9999999998824737 - 0.66666663142384005 * s) + s2 * (
            0.39999824101648243 - 0.28567961508030672 * s
        )
        middle = (0.22186482484637741 - 0.17960478202025713 * s) + s2 * (
            0.14491436906055761 - 0.10855822281912683 * s
        )
        high = (0.068419227079629696 - 0.032223368567186278 * s) + s2 * (
            0.0097018700375357559 - 0.0013695853097479123 * s
        )
        return low + s4 * (middle + s4 * high)
    low = (1.9999986956598918 - 0.66653029843842235 * s) + s2 * (
        0.39762964933865014 - 0.26974382883140577 * s
    )
    high = (0.16774238299551702 - 0.074026003007932665 * s) + s2 * 0.01572675350492383
    return low + s2 * s2 * high


@njit(**INLINED)
def turn(spec: Any, ax: Any, ay: Any, bx: Any, by: Any) -> Any:
    """Angle from unit vector a to unit vector b [rad], within 6e-11 of itself (f32: 7e-7).

    The tangent of half the angle between them, or of its complement behind 90 degrees, is at most 1: there
    a polynomial approximates the arc tangent.
    """
    cross = ax * by - ay * bx
    dot = ax * bx + ay * by
    behind = dot < 0.0
    t = cross * inverse(spec, 1.0 + select(behind, -dot, dot))
    angle = t * half_angle_ratio(spec, t * t)
    half_turn = select(cross < 0.0, splat(spec, -math.pi), math.pi)
    return select(behind, half_turn - angle, angle)


@njit(**INLINED)
def drag(c: Any, spec: Any, squared_speed: Any) -> tuple[Any, Any]:
    """Drag per speed [N s/m/kg], and its derivative by speed over the speed [N s^3/m^3/kg]."""
    squared = maximum(squared_speed, 1e-20)
    per_speed = inverse_root(spec, squared)
    quadratic = load(spec, c, DRAG_2)
    return load(spec, c, DRAG_1) + quadratic * (squared * per_speed), quadratic * per_speed


@njit(**INLINED)
def direction(spec: Any, d: Any, n: int, i: int) -> tuple[Any, Any]:
    """Direction of the string at point i = 1…n: the sum of the segments next to it, d of 2n rows."""
    tx, ty = load(spec, d, 2 * i - 2), load(spec, d, 2 * i - 1)
    if i < n:
        tx, ty = tx + load(spec, d, 2 * i), ty + load(spec, d, 2 * i + 1)
    return tx, ty


@njit(**INLINED)
def slender_drag(c: Any, spec: Any, tx: Any, ty: Any, vx: Any, vy: Any) -> tuple[Any, Any, Any, Any, Any]:
    """Drag that is smaller along the string than across it, by the same factor at all speeds.

    A factor of 1 is `drag`. Of a moving slender body the force along it is mostly skin friction (Hoerner,
    Fluid-Dynamic Drag, 1965, section 3.11).

    Parameters
    ----------
    tx, ty
        Direction of the string at the point, of any length above 0.
    vx, vy
        Velocity of the point [m/s].

    Returns
    -------
    Force by x and y, and half its derivative by velocity, symmetric: xx, yy, xy [N s/m/kg].
    """
    per_length = inverse_root(spec, maximum(tx * tx + ty * ty, 1e-20))
    tx, ty = tx * per_length, ty * per_length
    per_speed, slope = drag(c, spec, vx * vx + vy * vy)
    less = 1.0 - load(spec, c, ALONG)
    along = less * (vx * tx + vy * ty)
    wx, wy = vx - along * tx, vy - along * ty
    per_speed, slope = 0.5 * per_speed, 0.5 * slope
    xx, yy = per_speed * (1.0 - less * tx * tx), per_speed * (1.0 - less * ty * ty)
    xy = 0.5 * slope * (wx * vy + wy * vx) - per_speed * less * tx * ty
    fx, fy = -2.0 * per_speed * wx, -2.0 * per_speed * wy
    return fx, fy, xx + slope * wx * vx, yy + slope * wy * vy, xy


@njit(**INLINED)
def dry_friction(spec: Any, c: Any, factor: Any, rate: Any) -> Any:
    """Damping that acts like dry friction at this rate: its moment does not grow with the rate."""
    size = select(rate < 0.0, -rate, rate)
    return factor * load(spec, c, FRICTION) * inverse(spec, size + SLIP_RAD_S)


@njit(**INLINED)
def sticking_friction(
    spec: Any, c: Any, factor: Any, j: int, bend: Any, share: float, stick: Any
) -> tuple[Any, Any]:
    """Moment of dry friction that sticks, after Dahl; advances its state.

    Its share z of the full moment changes with the bend b alone: dz = (1 - z sgn(db)) db / s, where s is the
    bend over which friction builds up. A joint that stands still therefore keeps its moment, and a small
    bend meets a spring (P. R. Dahl, A Solid Friction Model, Aerospace Corporation, TOR-158(3107-18), 1968).

    Parameters
    ----------
    factor
        Multiplier of the moment.
    j, bend
        The joint, and its bend at this step [rad].
    share
        Below 1 at the first step, where friction is relaxed: z = 0.
    stick
        `StringMotion.stick`.

    Returns
    -------
    The moment, and the largest derivative that it may have by the bend in the coming step.
    """
    before, z = load(spec, stick, 2 * j), load(spec, stick, 2 * j + 1)
    if share < 1.0:
        before, z = bend, splat(spec, 0.0)
    change = bend - before
    size = select(change < 0.0, -change, change) * load(spec, c, PER_STICK)
    toward = select(change < 0.0, splat(spec, -1.0), 1.0)
    # exp(-size) to second order, by an approximant between 0 and 1, so that z cannot exceed 1.
    z = toward + (z - toward) * inverse(spec, 1.0 + size + 0.5 * size * size)
    store(spec, stick, 2 * j, bend)
    store(spec, stick, 2 * j + 1, z)
    full = factor * load(spec, c, STICKING)
    return full * z, full * load(spec, c, PER_STICK) * (1.0 + select(z < 0.0, -z, z))


@njit(**INLINED)
def joint(
    spec: Any,
    c: Any,
    reading: int,
    per_width: float,
    weight: Any,
    factor: Any,
    bend: Any,
    rate: Any,
    pull: Any,
) -> tuple[Any, Any, Any]:
    """Stiffness and damping of an inner joint: a blend of h and sh by the reading's switch.

    Parameters
    ----------
    reading
        RATE_READING: a growing bend takes h. SIGN_READING: a bend to the left does. STRAIN_READING: a
        compressed string does.
    per_width
        1 over the half-width of the blend.
    weight
        Weight of the point [N/kg].
    factor
        Multiplier of both.
    bend, rate
        Bend from rest [rad] and its rate [rad/s].
    pull
        Mean spring force of the two segments [N/kg].

    Returns
    -------
    Stiffness and damping, and the derivative of the moment by the rate: the damping, and what the switch adds
    to it where it depends on the rate, so that the scheme stays of second order there.
    """
    k_more, c_more = load(spec, c, K_MORE), load(spec, c, C_MORE)
    if reading == RATE_READING:
        switch = bend * rate
    elif reading == SIGN_READING:
        switch = bend
    else:
        switch = -pull / weight
    t = ramp(switch, per_width)
    share = blend(t)
    k = factor * (load(spec, c, K_SH) + k_more * share)
    damping = factor * (load(spec, c, C_SH) + c_more * share)
    slope = damping
    if reading == RATE_READING:
        more = (k_more * bend + c_more * rate) * (bend * factor)
        slope = damping + (3.0 * per_width) * (t - t * t) * more
    return k, damping, slope
