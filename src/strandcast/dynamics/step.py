"""One step: leapfrog with Crank-Nicolson dampers and averaged stiffness, one banded solve per step.

One kick of the velocities over a step h solves (M + h/2 C + h^2 B) dv = h f(x_n, v_{n-1/2}), where C holds
the dampers and B = beta K the stiffness averaged over three time levels. beta = 1/12 cancels the leading
dispersion error; an element too stiff for that gets what stability asks for, up to 1/4 (`averaged`).

The matrix is symmetric and couples points up to two apart: a segment its ends, a bend three in a row. A step
is three loops over the points, each with little to wait for: assemble from hand to tip; eliminate from hand
to tip (L D L^T in blocks of two by two; the block between points i and i + 2, a bend's, has rank one, so that
its share of the elimination only changes a weight and a vector); and back, kicking and drifting on the way.
"""

from typing import Any

from numba import njit

from strandcast.dynamics.banded import (
    ACROSS,
    AXIAL,
    BEND,
    MOMENT,
    PER_LENGTH,
    PULL,
    TURNING,
    UX,
    UY,
    Q,
    W,
    back,
    eliminate,
    leave,
)
from strandcast.dynamics.elements import (
    C_PH,
    C_S,
    CLAMP_OFFSET,
    FLOOR,
    K_PH,
    K_S,
    REST_BEND,
    direction,
    drag,
    dry_friction,
    joint,
    segment,
    slender_drag,
    sticking_friction,
    turn,
)
from strandcast.dynamics.hand import COS, DRATE, DVX, DVY, RATE, SIN, VX, VY
from strandcast.dynamics.simd import INLINED, load, maximum, minimum, splat, store
from strandcast.dynamics.string_state import ROWS, StepSettings, StringArrays, StringMotion

STABLE = 0.9  # of the largest step that averaging allows
_STIFF_DAMPING = 0.03  # more costs accuracy (0.5: seven times the error of a plausible cord at 1 ms)
_FINE = 1.0 / 12.0


@njit(**INLINED)
def stretch_damping(k_s: float, h: float, lightest: float) -> float:
    """Stretch damping to add [N s/m/kg] where the step cannot follow the stretch waves.

    Averaging alone leaves such waves undamped, and every turn of a segment feeds them. The damper acts on the
    stretch, which is micrometres there, and scales with the step; a string that diverges all the same is
    simulated again with smaller steps (`strandcast.dynamics.simulate`).
    """
    return _STIFF_DAMPING * h * max(k_s - STABLE * lightest / (4.0 * (0.25 - _FINE) * h * h), 0.0)


@njit(**INLINED)
def averaged(stiffness: Any, h2: float, floor: Any) -> Any:
    """h^2 beta k: beta is 1/12, or as much as keeps h^2 (1/4 - beta) k below `floor`."""
    return maximum(stiffness * (h2 / 12.0), stiffness * (h2 / 4.0) - floor)


@njit(**INLINED)
def _point(
    spec: Any, c: Any, h: float, gravity: float, mass: Any, vx: Any, vy: Any
) -> tuple[Any, Any, Any, Any, Any]:
    """Block of one point's own inertia and drag (xx, yy, xy), and its impulse by drag and weight."""
    per_speed, slope = drag(c, spec, vx * vx + vy * vy)
    along = (0.5 * h) * slope
    plain = mass + (0.5 * h) * per_speed
    ax, ay = along * vx, along * vy
    down = per_speed * vy + gravity * mass
    return plain + ax * vx, plain + ay * vy, ax * vy, -h * (per_speed * vx), -h * down


@njit(**INLINED)
def _slender_point(
    spec: Any, c: Any, h: float, gravity: float, mass: Any, vx: Any, vy: Any, tx: Any, ty: Any
) -> tuple[Any, Any, Any, Any, Any]:
    """Return the same as `_point` where drag along the string, in the direction (tx, ty), is smaller."""
    fx, fy, xx, yy, xy = slender_drag(c, spec, tx, ty, vx, vy)
    return mass + h * xx, mass + h * yy, h * xy, h * fx, h * (fy - gravity * mass)


@njit(**INLINED)
def advance(
    spec: Any, string: StringArrays, motion: StringMotion, hand: Any, work: Any, settings: StepSettings
) -> tuple[Any, Any]:
    """Advance velocities by `share` of a step and segments by a whole one.

    Parameters
    ----------
    spec
        `VectorSpec` of the values. All arrays are (rows, width).
    string, motion, settings
        See there; `motion` is changed.
    hand
        The hand at this step: the first eight values of `strandcast.dynamics.hand.drive`.
    work
        `ROWS` (n + 1) rows that the step may use.

    Returns
    -------
    Lengths of the longest and the shortest segment before the step [m].
    """
    h = settings.share * settings.step
    extent = _segments(spec, string, motion, hand, work, h, settings.l0)
    _bends(spec, string, hand, work)
    _joints(spec, string, hand, work, h, settings, motion.stick)
    _assemble(spec, string, motion, work, h, settings)
    tip_x, tip_y = eliminate(spec, string.n, work, hand[DVX], hand[DVY])
    back(spec, string.n, work, hand, settings.step, tip_x, tip_y, motion)
    return extent


@njit(**INLINED)
def _segments(
    spec: Any, string: StringArrays, motion: StringMotion, hand: Any, work: Any, h: float, l0: float
) -> tuple[Any, Any]:
    """Write all segments' rows of `work`; return the lengths of the longest and the shortest."""
    n, c, _, _ = string
    d, v, _, _ = motion
    k_s, c_s, floor = load(spec, c, K_S), load(spec, c, C_S), 0.25 * load(spec, c, FLOOR)
    vx, vy = hand[VX], hand[VY]
    longest, shortest = splat(spec, 0.0), splat(spec, 1e9)
    for j in range(n):
        wx, wy = -vx, -vy
        vx, vy = load(spec, v, 2 * j + 2), load(spec, v, 2 * j + 3)
        wx, wy = vx + wx, vy + wy
        ux, uy, length, per_length = segment(spec, load(spec, d, 2 * j), load(spec, d, 2 * j + 1))
        longest, shortest = maximum(length, longest), minimum(length, shortest)
        pull = k_s * (length - l0)
        r = ROWS * j
        store(spec, work, r + UX, ux)
        store(spec, work, r + UY, uy)
        store(spec, work, r + PER_LENGTH, per_length)
        store(spec, work, r + AXIAL, h * (pull + c_s * (wx * ux + wy * uy)))
        store(spec, work, r + ACROSS, averaged(maximum(pull, 0.0) * per_length, h * h, floor))
        store(spec, work, r + TURNING, (ux * wy - uy * wx) * per_length)
        store(spec, work, r + PULL, pull)
    return longest, shortest


@njit(**INLINED)
def _bends(spec: Any, string: StringArrays, hand: Any, work: Any) -> None:
    """Write the bend from rest of every joint into its row of `work`; joint 0 is the clamp."""
    n, c, _, _ = string
    rest = load(spec, c, REST_BEND)
    ux, uy = load(spec, work, UX), load(spec, work, UY)
    store(spec, work, BEND, turn(spec, hand[COS], hand[SIN], ux, uy) - load(spec, c, CLAMP_OFFSET))
    for j in range(1, n):
        before_x, before_y = ux, uy
        ux, uy = load(spec, work, ROWS * j + UX), load(spec, work, ROWS * j + UY)
        store(spec, work, ROWS * j + BEND, turn(spec, before_x, before_y, ux, uy) - rest)


@njit(**INLINED)
def _joints(
    spec: Any, string: StringArrays, hand: Any, work: Any, h: float, settings: StepSettings, stick: Any
) -> None:
    """Write impulse and weight of every joint's moment into its rows of `work`."""
    n, c, mass, factor = string
    _, share, l0, gravity, reading, per_width, has_friction, _, _, _ = settings
    h2, half = h * h, 0.5 * h
    floor = (l0 * l0 / 16.0) * load(spec, c, FLOOR)
    own = load(spec, factor, 0)
    k, damping = own * load(spec, c, K_PH), own * load(spec, c, C_PH)
    rate, pull = load(spec, work, TURNING), load(spec, work, PULL)
    if has_friction:
        damping += dry_friction(spec, c, own, rate - hand[RATE])
    bend = load(spec, work, BEND)
    moment = k * bend + damping * (rate - hand[RATE])
    if stick is not None:
        held, tangent = sticking_friction(spec, c, own, 0, bend, share, stick)
        moment, k = moment + held, k + tangent
    weight = averaged(k, h2, 4.0 * floor) + half * damping
    moment = h * moment - weight * hand[DRATE]
    store(spec, work, MOMENT, moment)
    store(spec, work, W, weight)
    for j in range(1, n):
        r = ROWS * j
        before, before_pull = rate, pull
        rate, pull = load(spec, work, r + TURNING), load(spec, work, r + PULL)
        bend, change = load(spec, work, r + BEND), rate - before
        point, mean = load(spec, mass, j - 1) * gravity, 0.5 * (before_pull + pull)
        own = load(spec, factor, j)
        k, damping, slope = joint(spec, c, reading, per_width, point, own, bend, change, mean)
        if has_friction:
            more = dry_friction(spec, c, own, change)
            damping, slope = damping + more, slope + more
        moment = k * bend + damping * change
        if stick is not None:
            held, tangent = sticking_friction(spec, c, own, j, bend, share, stick)
            moment, k = moment + held, k + tangent
        store(spec, work, r + MOMENT, h * moment)
        # A switch may add energy faster than a step can follow; the matrix stays positive.
        store(spec, work, r + W, averaged(k, h2, floor) + maximum(half * slope, -0.5 * floor))


@njit(**INLINED)
def _assemble(
    spec: Any, string: StringArrays, motion: StringMotion, work: Any, h: float, settings: StepSettings
) -> None:
    """Replace the elements in `work` by all points' blocks and right sides, without each bend's last end."""
    n, c, mass, _ = string
    d, v, _, _ = motion
    gravity = settings.gravity
    zero = splat(spec, 0.0)
    floor_segment = 0.25 * load(spec, c, FLOOR)
    along = averaged(load(spec, c, K_S), h * h, floor_segment) + (0.5 * h) * load(spec, c, C_S)
    # Point i = j - 1 waits for its last joint, j for its segment; the hand's own block is never read.
    px, py, ixx, iyy, ixy, irx, iry = zero, zero, zero, zero, zero, zero, zero
    e0, e1, e2, e3 = zero, zero, zero, zero
    xx, yy, xy, rx, ry = zero, zero, zero, zero, zero
    for j in range(n):
        r = ROWS * j
        ux, uy, per_length = (
            load(spec, work, r + UX),
            load(spec, work, r + UY),
            load(spec, work, r + PER_LENGTH),
        )
        axial, across = load(spec, work, r + AXIAL), load(spec, work, r + ACROSS)
        moment, weight = load(spec, work, r + MOMENT), load(spec, work, r + W)
        qx, qy = -uy * per_length, ux * per_length
        more = along - across
        mx, my = more * ux, more * uy
        sxx, syy, sxy = across + mx * ux, across + my * uy, mx * uy
        ax, ay = axial * ux, axial * uy
        # Gradient of the bend: p on point i, g on j, q on j + 1.
        gx, gy = -px - qx, -py - qy
        bpx, bpy, bgx, bgy = weight * px, weight * py, weight * gx, weight * gy
        if j > 0:
            own_xx, own_yy, own_xy = ixx + bpx * px, iyy + bpy * py, ixy + bpx * py
            right_x, right_y = irx - moment * px, iry - moment * py
            f0, f1, f2, f3 = e0 + bgx * px, e1 + bgx * py, e2 + bgy * px, e3 + bgy * py
            leave(spec, work, j - 1, own_xx, own_yy, own_xy, right_x, right_y, f0, f1, f2, f3)
        store(spec, work, r + Q, qx)
        store(spec, work, r + Q + 1, qy)
        ixx, iyy, ixy = xx + sxx + bgx * gx, yy + syy + bgy * gy, xy + sxy + bgx * gy
        irx, iry = rx + ax - moment * gx, ry + ay - moment * gy
        e0, e1, e2, e3 = qx * bgx - sxx, qx * bgy - sxy, qy * bgx - sxy, qy * bgy - syy
        own, vx, vy = load(spec, mass, j), load(spec, v, 2 * j + 2), load(spec, v, 2 * j + 3)
        if settings.slender is None:
            xx, yy, xy, rx, ry = _point(spec, c, h, gravity, own, vx, vy)
        else:
            tx, ty = direction(spec, d, n, j + 1)
            xx, yy, xy, rx, ry = _slender_point(spec, c, h, gravity, own, vx, vy, tx, ty)
        if j == 0:
            # The clamp's bend has no joint behind it to be eliminated with: all of it is here.
            bx, by = weight * qx, weight * qy
            xx, yy, xy = xx + bx * qx, yy + by * qy, xy + bx * qy
        xx, yy, xy = xx + sxx, yy + syy, xy + sxy
        rx -= ax + moment * qx
        ry -= ay + moment * qy
        px, py = qx, qy
    leave(spec, work, n - 1, ixx, iyy, ixy, irx, iry, e0, e1, e2, e3)
    leave(spec, work, n, xx, yy, xy, rx, ry, e0, e1, e2, e3)
    store(spec, work, ROWS * n + W, zero)
    store(spec, work, ROWS * n + Q, zero)
    store(spec, work, ROWS * n + Q + 1, zero)
