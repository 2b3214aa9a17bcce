"""One step of the string in space: the plane's leapfrog with Crank-Nicolson dampers and averaged stiffness.

See `strandcast.dynamics.step`. The matrix couples points up to two apart in blocks of three by three:
in differences of velocities it is a segment's and its two joints' own block H, and a block G of each joint
between its two segments. Point i's own block is mass + H_(i-1) + H_i - G_i - G_i^T, those to the next points
are G_i + G_(i+1) - H_i and -G_(i+1). It is eliminated point by point from the clamp on (L D L^T).

A step is seven loops over the points, each short and with little to wait for: processors look ahead by a few
hundred instructions only, and longer loops keep too many values for their registers.

Joints also exert moments about the string's own axis: where the string is bent away from its rest shape and
damped or curled, a turn of its frame does work. They sum up from the free end, or from the second clamp,
which lets the string turn about its axis. As they couple each joint with all before it, they stay out of the
matrix and take extrapolated velocities, which is stable for as much damping as inertia can hold. The rest is
bounded by terms of one joint each (`_spread`): the matrix takes these for the coming change of velocity, and
the forces take them off for the last one. The bounds act normal to the plane of the joint's bend, so that a
string that moves in a plane is not changed.
"""

from typing import Any, NamedTuple

from numba import njit

from strandcast.dynamics.elements import ALONG as DRAG_SHARE
from strandcast.dynamics.elements import (
    C_MORE,
    C_PH,
    C_S,
    COEFFICIENTS,
    FLOOR,
    K_PH,
    K_S,
    RATE_READING,
    drag,
    dry_friction,
    joint,
    ramp,
)
from strandcast.dynamics.simd import (
    INLINED,
    inverse_root,
    load,
    maximum,
    minimum,
    select,
    splat,
    store,
)
from strandcast.dynamics.spatial.joints import (
    across,
    bend_from_rest,
    mixed_block,
    relative_rate,
    side_by_side,
    size_of,
    sticking_friction_in_space,
    transported,
)
from strandcast.dynamics.spatial.triples import (
    backward3,
    combined,
    cross,
    diagonal_plus6,
    divided3,
    divided9,
    dot,
    factored6,
    forward3,
    forward9,
    load3,
    minus,
    minus6,
    minus_full_of,
    minus_product6,
    minus_transposed_times9,
    outer6,
    plus,
    plus6,
    plus9,
    plus_product,
    plus_scaled,
    plus_scaled6,
    scaled,
    scaled6,
    store3,
    times9,
    transposed_product6,
    transposed_times9,
    twice_symmetric_part,
    zero3,
)
from strandcast.dynamics.step import averaged
from strandcast.dynamics.string_state import StepSettings, StringArrays, StringMotion

# Coefficients after those of the plane: rest spacing [m]; direction of each clamp, rest bend [rad] and
# a normal of the first clamp's direction in the frame of its pose; cosine and sine of the rest bend's turn
# per segment.
L0, DIRECTION, REST, FAR_DIRECTION, SIDE, TORSION, SPATIAL_COEFFICIENTS = (
    COEFFICIENTS + k for k in (0, 1, 4, 7, 10, 13, 15)
)

# Work rows of segment j, of the joint before it, and of point j. First the elements: AHEAD is half the last
# change of a segment's turn rate, REACH what tangents of half the bends add up to. What follows from them
# replaces what is no longer needed.
UNIT, PER_LENGTH, ACROSS, PER, TURNING, AHEAD, PULL, BEND, AXIAL, PER_SINE, PER_TANGENT, REACH, RATIO = (
    0,
    3,
    4,
    5,
    6,
    9,
    12,
    13,
    16,
    17,
    18,
    19,
    20,
)
# SPIN_CHANGE is a joint's last change of spin, OUT_OF_PLANE the bound of its bending out of its plane,
# SPIN_DAMPING the damping of spins times REACH.
WEIGHT, TORQUE, SPIN_CHANGE, OUT_OF_PLANE, MOMENT, SPIN_DAMPING = 6, 7, 8, 9, BEND, REACH
# Weights of a joint's block normal to its plane: in both segments' own blocks, and between them.
NORMAL, NORMAL_BETWEEN = TORQUE, SPIN_CHANGE
# Blocks to the next two points, impulse and own block; from these, what `_back` takes.
TO_NEXT, TO_AFTER, IMPULSE, OWN = 0, 9, 18, 21
NEXT, OVER_NEXT, CHANGED, LOWER = TO_NEXT, TO_AFTER, IMPULSE, OWN
SPATIAL_ROWS = 27


class ClampMotion(NamedTuple):
    """A clamp at one step: velocity, its change, frame of three vectors, turn rate and its change."""

    v: Any
    dv: Any
    frame: Any
    rate: Any
    change: Any


@njit(**INLINED)
def step_in_space(
    spec: Any,
    string: StringArrays,
    motion: StringMotion,
    clamp: ClampMotion,
    far: ClampMotion,
    work: Any,
    settings: StepSettings,
) -> tuple[Any, Any]:
    """Advance velocities by `share` of a step and segments by a whole one; return as `advance` does.

    Without a second driven end, `far` is not read.
    """
    if settings.two_ends:
        store3(spec, motion.v, 3 * string.n, far.v)
        store3(spec, motion.dv, 3 * string.n, far.dv)
    extent = _segments(spec, string, motion, clamp, work, settings)
    ahead = combined(clamp.frame, load3(spec, string.c, DIRECTION))
    behind = scaled(splat(spec, -1.0), combined(far.frame, load3(spec, string.c, FAR_DIRECTION)))
    _bends(spec, string, clamp, ahead, behind, work, settings, motion.stick)
    _joints(spec, string, clamp, far, ahead, behind, work, settings, motion.stick)
    _impulses(spec, string, motion, ahead, behind, work, settings)
    _assemble(spec, string, ahead, work, settings)
    tip = _eliminate(spec, string.n, clamp.dv, work)
    _back(spec, string.n, motion, clamp, far.dv if settings.two_ends else tip, work, settings.step)
    return extent


@njit(**INLINED)
def _segments(
    spec: Any,
    string: StringArrays,
    motion: StringMotion,
    clamp: ClampMotion,
    work: Any,
    settings: StepSettings,
) -> tuple[Any, Any]:
    """Write all segments' rows; return the lengths of the longest and the shortest."""
    v, dv = clamp.v, clamp.dv
    n, c, _, _ = string
    k_s, c_s, l0 = load(spec, c, K_S), load(spec, c, C_S), load(spec, c, L0)
    floor = 0.25 * load(spec, c, FLOOR)
    h, longest, shortest = settings.share * settings.step, splat(spec, 0.0), splat(spec, 1e9)
    for j in range(n):
        before, dv_before = v, dv
        v, dv = load3(spec, motion.v, 3 * j + 3), load3(spec, motion.dv, 3 * j + 3)
        w, d = minus(v, before), load3(spec, motion.d, 3 * j)
        squared = dot(d, d)
        per_length = inverse_root(spec, squared)
        length, u = squared * per_length, scaled(per_length, d)
        longest, shortest = maximum(length, longest), minimum(length, shortest)
        pull = k_s * (length - l0)
        r = SPATIAL_ROWS * j
        store3(spec, work, r + UNIT, u)
        store(spec, work, r + PER_LENGTH, per_length)
        store(spec, work, r + AXIAL, h * (pull + c_s * dot(w, u)))
        store(spec, work, r + ACROSS, averaged(maximum(pull, 0.0) * per_length, h * h, floor))
        store3(spec, work, r + TURNING, scaled(per_length, cross(u, w)))
        store3(spec, work, r + AHEAD, scaled(0.5 * per_length, cross(u, minus(dv, dv_before))))
        store(spec, work, r + PULL, pull)
    return longest, shortest


@njit(**INLINED)
def _bends(
    spec: Any,
    string: StringArrays,
    clamp: ClampMotion,
    ahead: Any,
    behind: Any,
    work: Any,
    settings: StepSettings,
    stick: Any,
) -> None:
    """Write the bend from rest and the angle's functions of every joint; joints 0 and n are the clamps."""
    n, c, _, _ = string
    a, rest = ahead, combined(clamp.frame, load3(spec, c, REST))
    reach = splat(spec, 0.0)
    if settings.two_ends:
        store3(spec, work, SPATIAL_ROWS * n + UNIT, behind)
    for j in range(n + 1 if settings.two_ends else n):
        r = SPATIAL_ROWS * j
        b = load3(spec, work, r + UNIT)
        binormal, middle, per, ratio, per_sine, per_tangent = side_by_side(spec, a, b)
        halfway, rest = transported(b, middle, per, rest)
        if settings.helical:
            onward = scaled(load(spec, c, TORSION + 1), cross(b, rest))
            rest = plus_scaled(onward, load(spec, c, TORSION), rest)
        if j == 0 or j == n:
            bend = scaled(ratio, binormal)
        else:
            bend = bend_from_rest(binormal, ratio, per_sine, halfway)
        half_tangent = (0.5 * per_sine) * dot(binormal, binormal) * per
        store3(spec, work, r + BEND, bend)
        store(spec, work, r + PER, per)
        store(spec, work, r + PER_SINE, per_sine)
        store(spec, work, r + PER_TANGENT, per_tangent)
        store(spec, work, r + REACH, reach + half_tangent)
        if stick is not None:
            store(spec, work, r + RATIO, ratio)
        reach = reach + 2.0 * half_tangent
        a = b


@njit(**INLINED)
def _joints(
    spec: Any,
    string: StringArrays,
    clamp: ClampMotion,
    far: ClampMotion,
    ahead: Any,
    behind: Any,
    work: Any,
    settings: StepSettings,
    stick: Any,
) -> None:
    """Write moment, weight and torque about the string of every joint.

    Spins and torques take the velocities of this step, extrapolated. The matrix holds what the switch between
    h and sh adds to a damper as if it were the same in all directions; `more`, `along` and `sideways` correct
    the moment for that.
    """
    n, c, mass, factor = string
    l0 = load(spec, c, L0)
    floor = (l0 * l0 / 16.0) * load(spec, c, FLOOR)
    h = settings.share * settings.step
    a, rate_a, more_a = ahead, across(ahead, clamp.rate), scaled(0.5, across(ahead, clamp.change))
    clamp_now = plus_scaled(clamp.rate, 0.5, clamp.change)
    spin = dot(clamp_now, ahead)
    side = combined(clamp.frame, load3(spec, c, SIDE))
    pull = load(spec, work, PULL)
    if settings.two_ends:
        r = SPATIAL_ROWS * n
        store3(spec, work, r + TURNING, across(behind, far.rate))
        store3(spec, work, r + AHEAD, scaled(0.5, across(behind, far.change)))
    for j in range(n + 1 if settings.two_ends else n):
        r = SPATIAL_ROWS * j
        b, rate_b = load3(spec, work, r + UNIT), load3(spec, work, r + TURNING)
        more_b, bend = load3(spec, work, r + AHEAD), load3(spec, work, r + BEND)
        per = load(spec, work, r + PER)
        middle, turned = plus(a, b), minus(b, a)
        ahead_of, spin_more = relative_rate(middle, per, minus(more_b, more_a))
        rate, own_spin = relative_rate(middle, per, minus(rate_b, rate_a))
        own_spin = own_spin + spin_more
        rate = plus_scaled(rate, spin - 0.5 * own_spin, turned)
        spin = spin - own_spin
        sideways = along = splat(spec, 0.0)
        if j == 0 or j == n:
            own, clamped = load(spec, factor, 0), load(spec, c, K_PH)
            k, damping = own * clamped, own * load(spec, c, C_PH)
            rubs = select(clamped > 0.0, own, 0.0)  # a clamp without stiffness is a point
            slope, least = damping, 4.0 * floor
        else:
            own = rubs = load(spec, factor, j)
            before_pull, pull = pull, load(spec, work, r + PULL)
            size, per_size = size_of(spec, bend)
            growth = dot(bend, rate) * per_size
            k, damping, slope = joint(
                spec,
                c,
                settings.reading,
                settings.per_width,
                load(spec, mass, j - 1) * settings.gravity,
                own,
                size,
                growth,
                0.5 * (before_pull + pull),
            )
            least = floor
            if settings.reading == RATE_READING:
                t = ramp(size * growth, settings.per_width)
                sideways = own * load(spec, c, C_MORE) * ((3.0 * settings.per_width) * (t - t * t)) * size
                ahead_by = per_size * dot(bend, ahead_of)
                sideways = sideways * ahead_by
                along = per_size * ((slope - damping) * ahead_by - sideways * growth)
        more = slope - damping
        if settings.has_friction:
            rubbing = dry_friction(spec, c, rubs, size_of(spec, rate)[0])
            damping, slope = damping + rubbing, slope + rubbing
        rubbed, tangent = zero3(spec), splat(spec, 0.0)
        if stick is not None:
            binormal, ratio = cross(a, b), load(spec, work, r + RATIO)
            upward = cross(a, side)
            in_frame = ratio * dot(binormal, side), ratio * dot(binormal, upward)
            x, y, tangent = sticking_friction_in_space(spec, c, rubs, j, in_frame, settings.share, stick)
            constant, _ = transported(b, middle, per, plus_scaled(scaled(x, side), y, upward))
            # Constant in the string's frame, it works on turns as the rest bend does.
            held_back = bend_from_rest(binormal, ratio, load(spec, work, r + PER_SINE), constant)
            rubbed = minus(scaled(ratio, binormal), held_back)
            _, side = transported(b, middle, per, side)
        weight = averaged(k + tangent, h * h, least) + maximum(0.5 * h * slope, -0.5 * least)
        # Moment and torque are sums of stiffness, damping, and what the switch adds in its own directions.
        along, sideways = h * k + h * along, h * sideways
        out_of_plane = maximum(0.5 * h * damping - least, 0.0)
        spin_damping = 0.5 * h * damping * dot(turned, turned) * load(spec, work, r + REACH)
        damping, more = h * damping, h * more
        with_rate, ahead_turned = damping + sideways, dot(ahead_of, turned)
        moment = plus_scaled(scaled(along, bend), with_rate, rate)
        torque = along * dot(bend, turned) + with_rate * dot(rate, turned) + damping * ahead_turned
        if stick is not None:
            moment = plus_scaled(moment, h, rubbed)
            torque = torque + h * dot(rubbed, turned)
        outward = 2.0 * out_of_plane * _per_turned(spec, work, r) * ahead_turned
        moment = plus_scaled(moment, -outward, turned)
        store3(spec, work, r + MOMENT, plus_scaled(moment, -more, ahead_of))
        store(spec, work, r + WEIGHT, weight)
        store(spec, work, r + TORQUE, torque)
        store(spec, work, r + SPIN_CHANGE, 2.0 * spin_more)
        store(spec, work, r + OUT_OF_PLANE, out_of_plane)
        store(spec, work, r + SPIN_DAMPING, spin_damping)
        a, rate_a, more_a = b, rate_b, more_b
    driven = scaled(splat(spec, -1.0), across(ahead, clamp.change))
    _drive(spec, work, 0, ahead, load3(spec, work, UNIT), driven)
    if settings.two_ends:
        _drive(
            spec,
            work,
            n,
            load3(spec, work, SPATIAL_ROWS * (n - 1) + UNIT),
            behind,
            across(behind, far.change),
        )


@njit(**INLINED)
def _drive(spec: Any, work: Any, j: int, a: Any, b: Any, change: Any) -> None:
    """Add what the clamp's change of turn rate contributes to the moment of its joint j, between a and b."""
    r, turned = SPATIAL_ROWS * j, minus(b, a)
    driven, spin = relative_rate(plus(a, b), load(spec, work, r + PER), change)
    store(spec, work, r + SPIN_CHANGE, load(spec, work, r + SPIN_CHANGE) - spin)
    moment = plus_scaled(load3(spec, work, r + MOMENT), load(spec, work, r + WEIGHT), driven)
    outward = load(spec, work, r + OUT_OF_PLANE) * _per_turned(spec, work, r) * dot(driven, turned)
    store3(spec, work, r + MOMENT, plus_scaled(moment, outward, turned))


@njit(**INLINED)
def _per_turned(spec: Any, work: Any, r: int) -> Any:
    """Return 1 / |b - a|^2 of a joint: along b - a a relative turn bends it out of its plane."""
    return (0.5 * load(spec, work, r + PER_SINE)) * load(spec, work, r + PER_TANGENT)


@njit(**INLINED)
def _impulses(
    spec: Any,
    string: StringArrays,
    motion: StringMotion,
    ahead: Any,
    behind: Any,
    work: Any,
    settings: StepSettings,
) -> None:
    """Write every point's impulse, and its own inertia and drag.

    A segment pulls at its first point and pushes at its second. A torque about the string, summed up from its
    end, acts like a moment along a + b.
    """
    n, c = string.n, string.c
    l0 = load(spec, c, L0)
    floor = (l0 * l0 / 16.0) * load(spec, c, FLOOR)
    torque = spins = splat(spec, 0.0)
    after = pull = zero3(spec)
    b = load3(spec, work, SPATIAL_ROWS * (n - 1) + UNIT)
    if settings.two_ends:
        middle, per = plus(b, behind), load(spec, work, SPATIAL_ROWS * n + PER)
        own = load(spec, work, SPATIAL_ROWS * n + TORQUE)
        held_back, spins = _spread(spec, work, SPATIAL_ROWS * n, spins, floor)
        moment = load3(spec, work, SPATIAL_ROWS * n + MOMENT)
        after = plus_scaled(moment, -((0.5 * own) * per + held_back), middle)
        torque = torque + own
    for j in range(n - 1, -1, -1):
        r = SPATIAL_ROWS * j
        a = ahead
        if j > 0:
            a = load3(spec, work, r - SPATIAL_ROWS + UNIT)
        middle, per = plus(a, b), load(spec, work, r + PER)
        own = load(spec, work, r + TORQUE)
        held_back, spins = _spread(spec, work, r, spins, floor)
        moment = load3(spec, work, r + MOMENT)
        moment = plus_scaled(moment, -((torque + 0.5 * own) * per + held_back), middle)
        torque = torque + own
        shear = scaled(load(spec, work, r + PER_LENGTH), cross(minus(moment, after), b))
        push, pull = pull, plus_scaled(shear, load(spec, work, r + AXIAL), b)
        inertia, impulse = _point(spec, string, motion, j + 1, settings)
        store3(spec, work, r + SPATIAL_ROWS + IMPULSE, plus(impulse, minus(push, pull)))
        _store6(spec, work, r + SPATIAL_ROWS + OWN, inertia)
        after = moment
        b = a


@njit(**INLINED)
def _point(
    spec: Any, string: StringArrays, motion: StringMotion, i: int, settings: StepSettings
) -> tuple[Any, Any]:
    """Return point i's own inertia and drag as a symmetric block, and its impulse by drag and weight."""
    n, c, mass, _ = string
    v, own = load3(spec, motion.v, 3 * i), load(spec, mass, i - 1)
    per_speed, slope = drag(c, spec, dot(v, v))
    h = settings.share * settings.step
    w, drag_share = v, h * per_speed
    per_speed, slope = 0.5 * h * per_speed, 0.5 * h * slope
    if settings.slender:
        t = load3(spec, motion.d, 3 * i - 3)
        if i < n:
            t = plus(t, load3(spec, motion.d, 3 * i))
        t = scaled(inverse_root(spec, maximum(dot(t, t), 1e-20)), t)
        less = 1.0 - load(spec, c, DRAG_SHARE)
        w = plus_scaled(v, -less * dot(v, t), t)
        # Half the derivative of per_speed w by v, symmetric: v w^T + w v^T = 2 x x^T - 2 y y^T of half of
        # their sum and difference.
        block = outer6(slope, scaled(0.5, plus(v, w)))
        block = plus6(block, outer6(-slope, scaled(0.5, minus(v, w))))
        block = plus6(block, outer6(-less * per_speed, t))
    else:
        block = outer6(slope, v)
    force = scaled(-drag_share, w)
    down = h * settings.gravity * own
    return diagonal_plus6(own + per_speed, block), (force[0], force[1], force[2] - down)


@njit(**INLINED)
def _spread(spec: Any, work: Any, r: int, spins: Any, floor: Any) -> tuple[Any, Any]:
    """Write the weights normal to a joint's plane; return what acts along a + b, and the joints' sum so far.

    Joint j's spin is the sum of what the joints before it spin, s_i, and half of its own. By Cauchy and
    Schwarz, for any p_i > 0, (sum s_i)^2 <= sum p_i sum s_i^2 / p_i: the damping of all spins is at most a
    sum of terms of one joint each. With p_i the tangent of half the bend, a term's weight on velocities
    normal to the joint's plane grows like the bend. `floor` is what inertia holds of it.
    """
    own, per_tangent = load(spec, work, r + SPIN_DAMPING), load(spec, work, r + PER_TANGENT)
    bound = maximum(spins + 0.5 * own - floor * per_tangent, 0.0) * load(spec, work, r + PER_SINE)
    weight, change = load(spec, work, r + WEIGHT) - 2.0 * bound, load(spec, work, r + SPIN_CHANGE)
    turned = load(spec, work, r + OUT_OF_PLANE) * (per_tangent * per_tangent)
    store(spec, work, r + NORMAL, weight - turned)
    store(spec, work, r + NORMAL_BETWEEN, weight + turned)
    return bound * change, spins + own


@njit(**INLINED)
def _assemble(spec: Any, string: StringArrays, ahead: Any, work: Any, settings: StepSettings) -> None:
    """Write every point's block, and those to the next two points."""
    # In the row after the last joint weight and 1 / length are 0, as the workspace was made.
    n, c, zero = string.n, string.c, splat(spec, 0.0)
    h = settings.share * settings.step
    stretch = averaged(load(spec, c, K_S), h * h, 0.25 * load(spec, c, FLOOR))
    stretch = stretch + 0.5 * h * load(spec, c, C_S)
    u, per_length, weight = load3(spec, work, UNIT), load(spec, work, PER_LENGTH), load(spec, work, WEIGHT)
    normal, skew = load(spec, work, NORMAL), outer6(0.5 * load(spec, work, PER), cross(ahead, u))
    before = zero, zero, zero, zero, zero, zero, zero, zero, zero
    segment_before = zero, zero, zero, zero, zero, zero
    for j in range(n):
        r = SPATIAL_ROWS * (j + 1)
        u_next, per_length_next = load3(spec, work, r + UNIT), load(spec, work, r + PER_LENGTH)
        weight_next, between = load(spec, work, r + WEIGHT), load(spec, work, r + NORMAL_BETWEEN)
        skew_next = outer6(0.5 * load(spec, work, r + PER), cross(u, u_next))
        squared, mixed = per_length * per_length, per_length * per_length_next
        normal, normal_before = load(spec, work, r + NORMAL), normal
        r -= SPATIAL_ROWS
        plain = load(spec, work, r + ACROSS) + (weight + weight_next) * squared
        segment = diagonal_plus6(plain, outer6(stretch - plain, u))
        segment = plus_scaled6(segment, -(normal_before * squared), skew)
        segment = plus_scaled6(segment, -(normal * squared), skew_next)
        skew_mixed = scaled6(between * mixed, skew_next)
        after = mixed_block(weight_next * mixed, u, u_next, dot(u, u_next), skew_mixed)
        own = plus6(_load6(spec, work, r + OWN), plus6(segment_before, segment))
        _store6(spec, work, r + OWN, minus6(own, twice_symmetric_part(before)))
        _store9(spec, work, r + TO_NEXT, minus_full_of(segment, plus9(before, after)))
        _store9(spec, work, r + TO_AFTER, after)
        u, per_length, weight, skew = u_next, per_length_next, weight_next, skew_next
        before, segment_before = after, segment
    r = SPATIAL_ROWS * n
    _store6(spec, work, r + OWN, plus6(_load6(spec, work, r + OWN), segment_before))


@njit(**INLINED)
def _eliminate(spec: Any, n: int, known: Any, work: Any) -> Any:
    """Eliminate point by point, point 0's change being known; return the last point's change.

    The rows of point i are left with its change if the next two did not change, and with how these enter.
    """
    zero, r = splat(spec, 0.0), SPATIAL_ROWS
    to_next, between = _load9(spec, work, TO_NEXT), _load9(spec, work, TO_AFTER)
    # Of the next point: its block, that to the one after, and the impulse; then what comes to the one after.
    block, impulse = _load6(spec, work, r + OWN), load3(spec, work, r + IMPULSE)
    impulse = minus_transposed_times9(impulse, to_next, known)
    to_next = _load9(spec, work, r + TO_NEXT)
    left_after = zero, zero, zero, zero, zero, zero
    impulse_after = transposed_times9(between, known)
    for j in range(1, n):
        r = SPATIAL_ROWS * (j + 1)
        # L D L^T of the point's own block; what it leaves to the next two is in terms of L^-1 of its row.
        factors = factored6(spec, block)
        nearer = forward9(factors, to_next)
        farther = forward9(factors, _load9(spec, work, r - SPATIAL_ROWS + TO_AFTER))
        total = forward3(factors, impulse)
        share, farther_share = divided9(factors, nearer), divided9(factors, farther)
        block = minus_product6(minus6(_load6(spec, work, r + OWN), left_after), nearer, share)
        to_next = plus_product(_load9(spec, work, r + TO_NEXT), nearer, farther_share)
        left_after = transposed_product6(farther, farther_share)
        impulse = plus(load3(spec, work, r + IMPULSE), impulse_after)
        impulse = minus_transposed_times9(impulse, share, total)
        impulse_after = transposed_times9(farther_share, total)
        r -= SPATIAL_ROWS
        _store9(spec, work, r + NEXT, share)
        _store9(spec, work, r + OVER_NEXT, farther_share)
        store3(spec, work, r + CHANGED, divided3(factors, total))
        store3(spec, work, r + LOWER, factors[3:6])
    factors = factored6(spec, block)
    total = forward3(factors, impulse)
    return backward3(factors[3:6], divided3(factors, total))


@njit(**INLINED)
def _store6(spec: Any, array: Any, row: int, a: Any) -> None:
    store3(spec, array, row, a[0:3])
    store3(spec, array, row + 3, a[3:6])


@njit(**INLINED)
def _load6(spec: Any, array: Any, row: int) -> Any:
    return (*load3(spec, array, row), *load3(spec, array, row + 3))


@njit(**INLINED)
def _store9(spec: Any, array: Any, row: int, a: Any) -> None:
    store3(spec, array, row, a[0:3])
    store3(spec, array, row + 3, a[3:6])
    store3(spec, array, row + 6, a[6:9])


@njit(**INLINED)
def _load9(spec: Any, array: Any, row: int) -> Any:
    return (*load3(spec, array, row), *load3(spec, array, row + 3), *load3(spec, array, row + 6))


@njit(**INLINED)
def _back(
    spec: Any, n: int, motion: StringMotion, clamp: ClampMotion, tip: Any, work: Any, step: float
) -> None:
    """From the last point's change back to the clamp: kick the velocities, drift the segments."""
    d, v, dv, _ = motion
    after, change = zero3(spec), tip
    v_after = plus(load3(spec, v, 3 * n), change)
    store3(spec, v, 3 * n, v_after)
    store3(spec, dv, 3 * n, change)
    for i in range(n - 1, -1, -1):
        r = SPATIAL_ROWS * i
        if i > 0:
            own = load3(spec, work, r + CHANGED)
            own = minus(own, times9(_load9(spec, work, r + NEXT), change))
            own = plus(own, times9(_load9(spec, work, r + OVER_NEXT), after))
            own = backward3(load3(spec, work, r + LOWER), own)
            after, change = change, own
            v_now = plus(load3(spec, v, 3 * i), change)
            store3(spec, v, 3 * i, v_now)
        else:
            change = clamp.dv
            v_now = plus(clamp.v, change)
        store3(spec, dv, 3 * i, change)
        store3(spec, d, 3 * i, plus_scaled(load3(spec, d, 3 * i), step, minus(v_after, v_now)))
        v_after = v_now
