"""One step of the string in space: the plane's leapfrog with Crank-Nicolson dampers and averaged stiffness.

See `strandcast.dynamics.schemes.lfcn`. The matrix couples points up to two apart in blocks of three by three:
in differences of velocities it is a segment's and its two joints' own block H, and a block G of each joint
between its two segments. Point i's own block is mass + H_(i-1) + H_i - G_i - G_i^T, those to the next points
are G_i + G_(i+1) - H_i and -G_(i+1). It is assembled and eliminated (L D L^T) in one loop from the clamp on.

Joints also exert moments about the string's own axis: where the string is bent away from its rest shape and
damped or curled, a turn of its frame does work. They sum up from the free end, or from the second clamp,
which lets the string turn about its axis.
"""

from typing import Any, NamedTuple

from numba import njit

from strandcast.dynamics.elements import ALONG as DRAG_SHARE
from strandcast.dynamics.elements import (
    C_MORE,
    C_PH,
    C_S,
    FLOOR,
    K_PH,
    K_S,
    RATE_READING,
    drag,
    dry_friction,
    joint,
    ramp,
)
from strandcast.dynamics.schemes.scheme import StringArrays, StringMotion
from strandcast.dynamics.simd import INLINED, inverse_root, load, maximum, minimum, splat, store
from strandcast.dynamics.spatial.joints import (
    across,
    bend_from_rest,
    mixed_block,
    relative_rate,
    side_by_side,
    size_of,
    transported,
)
from strandcast.dynamics.spatial.triples import (
    combined,
    cross,
    diagonal_plus6,
    dot,
    inverse6,
    load3,
    minus,
    minus6,
    minus9,
    minus_full_of,
    outer6,
    plus,
    plus6,
    plus9,
    plus_scaled,
    plus_scaled6,
    scaled,
    scaled6,
    scaled9,
    store3,
    symmetric_product,
    times6,
    times9,
    transposed_product,
    transposed_product6,
    transposed_times9,
    twice_symmetric_part,
    zero3,
)

# Coefficients after those of the plane: rest spacing [m]; direction of each clamp and rest bend [rad] in
# the frame of the clamp's pose.
L0, DIRECTION, REST, FAR_DIRECTION = 17, 18, 21, 24
SPATIAL_COEFFICIENTS = 27

# Work rows per segment and the joint before it; what follows from them replaces them in the same rows.
UNIT, PER_LENGTH, AXIAL, ACROSS, TURNING, PULL, MOMENT, WEIGHT, TORQUE, PER, AT_STEP = (
    0,
    3,
    4,
    5,
    6,
    9,
    10,
    13,
    14,
    15,
    16,
)
TENSION = TURNING  # sum of forces along and across a segment, once the joints are known
NEXT, OVER_NEXT, CHANGED = 0, 9, 18
SPATIAL_ROWS = 21


class SpatialSettings(NamedTuple):
    """Values common to all strings at one step in space.

    Attributes
    ----------
    step, kick
        Time over which segments drift and over which forces act [s].
    fine, coarse
        h^2 beta of elements, and of those too stiff for the step: see `schemes.lfcn.averaged`.
    half
        Half of `kick`, 0 to leave out the dampers.
    floor
        Share of the plane's `FLOOR`, 0 in statics.
    gravity
        Gravity along -z [m/s^2].
    reading, per_width, has_friction
        See `strandcast.dynamics.schemes.scheme.StepSettings`.
    slender, two_ends
        Whether drag differs along and across the string; whether the last point is driven, too.
    """

    step: float
    kick: float
    fine: float
    coarse: float
    half: float
    floor: float
    gravity: float
    reading: int
    per_width: float
    has_friction: bool
    slender: bool
    two_ends: bool


class ClampMotion(NamedTuple):
    """A clamp at one step: velocity, its change, frame of three vectors, turn rate and its change."""

    v: Any
    dv: Any
    frame: Any
    rate: Any
    change: Any


@njit(**INLINED)
def held(stiffness: Any, settings: SpatialSettings, floor: Any) -> Any:
    """h^2 beta k of an element."""
    return maximum(stiffness * settings.fine, stiffness * settings.coarse - floor)


@njit(**INLINED)
def step_in_space(
    spec: Any,
    string: StringArrays,
    motion: StringMotion,
    clamp: ClampMotion,
    far: ClampMotion,
    work: Any,
    settings: SpatialSettings,
) -> tuple[Any, Any]:
    """Advance velocities by `kick` and segments by `step`; return the longest and the shortest segment [m].

    Without a second driven end, `far` is not read.
    """
    if settings.two_ends:
        store3(spec, motion.v, 3 * string.n, far.v)
        store3(spec, motion.dv, 3 * string.n, far.dv)
    extent = _segments(spec, string, motion, clamp, work, settings)
    ahead = combined(clamp.frame, load3(spec, string.c, DIRECTION))
    behind = scaled(splat(spec, -1.0), combined(far.frame, load3(spec, string.c, FAR_DIRECTION)))
    _joints(spec, string, clamp, far, ahead, behind, work, settings)
    _tensions(spec, string, ahead, behind, work, settings.two_ends)
    tip = _eliminate(spec, string, motion, clamp.dv, ahead, behind, work, settings)
    _back(spec, string.n, motion, clamp, far.dv if settings.two_ends else tip, work, settings.step)
    return extent


@njit(**INLINED)
def _segments(
    spec: Any,
    string: StringArrays,
    motion: StringMotion,
    clamp: ClampMotion,
    work: Any,
    settings: SpatialSettings,
) -> tuple[Any, Any]:
    """Write all segments' rows; return the lengths of the longest and the shortest."""
    v, dv = clamp.v, clamp.dv
    n, c, _, _ = string
    k_s, c_s, l0 = load(spec, c, K_S), load(spec, c, C_S), load(spec, c, L0)
    floor = (0.25 * settings.floor) * load(spec, c, FLOOR)
    longest, shortest = splat(spec, 0.0), splat(spec, 1e9)
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
        store(spec, work, r + AXIAL, settings.kick * (pull + c_s * dot(w, u)))
        store(spec, work, r + ACROSS, held(maximum(pull, 0.0) * per_length, settings, floor))
        store3(spec, work, r + TURNING, scaled(per_length, cross(u, w)))
        w = plus_scaled(w, 0.5, minus(dv, dv_before))
        store3(spec, work, r + AT_STEP, scaled(per_length, cross(u, w)))
        store(spec, work, r + PULL, pull)
    return longest, shortest


@njit(**INLINED)
def _joints(
    spec: Any,
    string: StringArrays,
    clamp: ClampMotion,
    far: ClampMotion,
    ahead: Any,
    behind: Any,
    work: Any,
    settings: SpatialSettings,
) -> None:
    """Write moment, weight and torque about the string of every joint; joints 0 and n are the clamps.

    Spins and torques do not enter the matrix: they take the velocities of this step, extrapolated. The
    matrix holds what the switch between h and sh adds to a damper as if it were the same in all directions;
    `left_out` is what that leaves out.
    """
    n, c, mass, factor = string
    l0 = load(spec, c, L0)
    floor = (settings.floor / 16.0) * (l0 * l0) * load(spec, c, FLOOR)
    a, rate_a = ahead, across(ahead, clamp.rate)
    clamp_now = plus_scaled(clamp.rate, 0.5, clamp.change)
    now_a = across(ahead, clamp_now)
    spin, rest = dot(clamp_now, ahead), combined(clamp.frame, load3(spec, c, REST))
    pull = load(spec, work, PULL)
    own = load(spec, factor, 0)
    k_clamp, damping_clamp = own * load(spec, c, K_PH), own * load(spec, c, C_PH)
    for j in range(n + 1 if settings.two_ends else n):
        r = SPATIAL_ROWS * j
        if j < n:
            b, rate_b = load3(spec, work, r + UNIT), load3(spec, work, r + TURNING)
            now_b = load3(spec, work, r + AT_STEP)
        else:
            b, rate_b = behind, across(behind, far.rate)
            now_b = across(behind, plus_scaled(far.rate, 0.5, far.change))
        binormal, middle, per, ratio, per_sine = side_by_side(spec, a, b)
        now, more = relative_rate(middle, per, minus(now_b, now_a))
        turned, spin_here = minus(b, a), spin - 0.5 * more
        spin = spin - more
        rate, _ = relative_rate(middle, per, minus(rate_b, rate_a))
        rate = plus_scaled(rate, spin_here, turned)
        halfway, rest = transported(b, middle, per, rest)
        switched = left_out = zero3(spec)
        if j == 0 or j == n:
            bend = scaled(ratio, binormal)
            k, damping = k_clamp, damping_clamp
            slope, least = damping, 4.0 * floor
        else:
            bend = bend_from_rest(binormal, ratio, per_sine, halfway)
            before_pull, pull = pull, load(spec, work, r + PULL)
            size, per_size = size_of(spec, bend)
            k, damping, slope = joint(
                spec,
                c,
                settings.reading,
                settings.per_width,
                load(spec, mass, j - 1) * settings.gravity,
                load(spec, factor, j),
                size,
                dot(bend, rate) * per_size,
                0.5 * (before_pull + pull),
            )
            least = floor
            if settings.reading == RATE_READING:
                ahead_of = minus(plus_scaled(now, spin_here, turned), rate)
                step_bend = per_size * dot(bend, ahead_of)
                along_bend, more = scaled(per_size, bend), slope - damping
                t = ramp(dot(bend, rate), settings.per_width)
                c_more = (
                    load(spec, factor, j) * load(spec, c, C_MORE) * ((3.0 * settings.per_width) * (t - t * t))
                )
                off = plus_scaled(rate, -per_size * dot(bend, rate), along_bend)
                switched = plus_scaled(scaled(more * step_bend, along_bend), c_more * step_bend * size, off)
                left_out = plus_scaled(switched, -more, ahead_of)
        if settings.has_friction:
            rubbing = dry_friction(
                spec, c, own if j == 0 or j == n else load(spec, factor, j), size_of(spec, rate)[0]
            )
            damping, slope = damping + rubbing, slope + rubbing
        weight = held(k, settings, least) + maximum(settings.half * slope, -0.5 * least)
        stiff, damping = settings.kick * k, 2.0 * settings.half * damping
        moment = plus_scaled(plus_scaled(scaled(stiff, bend), damping, rate), 2.0 * settings.half, left_out)
        torque = stiff * dot(bend, turned) + damping * (dot(now, turned) + spin_here * dot(turned, turned))
        torque = torque + 2.0 * settings.half * dot(switched, turned)
        if j == 0:
            driven = relative_rate(middle, per, across(ahead, clamp.change))[0]
            moment = plus_scaled(moment, -weight, driven)
        if j == n:
            driven = relative_rate(middle, per, across(behind, far.change))[0]
            moment = plus_scaled(moment, weight, driven)
        store3(spec, work, r + MOMENT, moment)
        store(spec, work, r + WEIGHT, weight)
        store(spec, work, r + TORQUE, torque)
        store(spec, work, r + PER, per)
        a, rate_a, now_a = b, rate_b, now_b


@njit(**INLINED)
def _tensions(spec: Any, string: StringArrays, ahead: Any, behind: Any, work: Any, two_ends: bool) -> None:
    """Write the impulse with which every segment pulls at its first point, and pushes at its second.

    A torque about the string, summed up from its end, acts like a moment along a + b.
    """
    n = string.n
    torque = splat(spec, 0.0)
    after = zero3(spec)
    b = load3(spec, work, SPATIAL_ROWS * (n - 1) + UNIT)
    if two_ends:
        middle, per = plus(b, behind), load(spec, work, SPATIAL_ROWS * n + PER)
        own = load(spec, work, SPATIAL_ROWS * n + TORQUE)
        after = plus_scaled(load3(spec, work, SPATIAL_ROWS * n + MOMENT), (-0.5 * own) * per, middle)
        torque = torque + own
    for j in range(n - 1, -1, -1):
        r = SPATIAL_ROWS * j
        a = ahead
        if j > 0:
            a = load3(spec, work, r - SPATIAL_ROWS + UNIT)
        middle, per = plus(a, b), load(spec, work, r + PER)
        own = load(spec, work, r + TORQUE)
        moment = plus_scaled(load3(spec, work, r + MOMENT), -(torque + 0.5 * own) * per, middle)
        torque = torque + own
        shear = scaled(load(spec, work, r + PER_LENGTH), cross(minus(moment, after), b))
        store3(spec, work, r + TENSION, plus_scaled(shear, load(spec, work, r + AXIAL), b))
        after = moment
        b = a


@njit(**INLINED)
def _point(
    spec: Any, string: StringArrays, motion: StringMotion, i: int, settings: SpatialSettings
) -> tuple[Any, Any]:
    """Return inertia and drag of point i, a symmetric block, and its impulse by drag and weight."""
    n, c, mass, _ = string
    v, own = load3(spec, motion.v, 3 * i), load(spec, mass, i - 1)
    per_speed, slope = drag(c, spec, dot(v, v))
    if settings.slender:
        t = load3(spec, motion.d, 3 * i - 3)
        if i < n:
            t = plus(t, load3(spec, motion.d, 3 * i))
        t = scaled(inverse_root(spec, maximum(dot(t, t), 1e-20)), t)
        less = 1.0 - load(spec, c, DRAG_SHARE)
        w = plus_scaled(v, -less * dot(v, t), t)
        # Half the derivative of per_speed w by v, symmetric.
        block = plus6(outer6(-less * per_speed, t), outer6(0.5 * slope, plus(v, w)))
        block = minus6(block, plus6(outer6(0.5 * slope, v), outer6(0.5 * slope, w)))
        block = scaled6(settings.half, diagonal_plus6(per_speed, block))
    else:
        w = v
        block = scaled6(settings.half, diagonal_plus6(per_speed, outer6(slope, v)))
    x, y, z = scaled(-settings.kick * per_speed, w)
    return diagonal_plus6(own, block), (x, y, z - settings.kick * settings.gravity * own)


@njit(**INLINED)
def _eliminate(
    spec: Any,
    string: StringArrays,
    motion: StringMotion,
    known: Any,
    ahead: Any,
    behind: Any,
    work: Any,
    settings: SpatialSettings,
) -> Any:
    """Assemble and eliminate point by point, point 0's change being known; return the last point's change.

    The rows of point i are left with its change if the next two did not change, and with how these enter.
    """
    n, c, _, _ = string
    stiff = held(load(spec, c, K_S), settings, (0.25 * settings.floor) * load(spec, c, FLOOR))
    stretch = stiff + settings.half * load(spec, c, C_S)
    zero = splat(spec, 0.0)
    none = zero, zero, zero
    none6 = zero, zero, zero, zero, zero, zero
    none9 = zero, zero, zero, zero, zero, zero, zero, zero, zero
    # What was eliminated leaves to the next point, between it and the one after, and to the one after.
    left, left_between, left_after = none6, none9, none6
    force, force_after = none, none
    u, per_length = load3(spec, work, UNIT), load(spec, work, PER_LENGTH)
    # Of the joint before a segment: a weight over its length squared, and the block that goes with it.
    own = load(spec, work, WEIGHT) * (per_length * per_length)
    skewed = outer6(0.5 * load(spec, work, PER), cross(ahead, u))
    before, between, tension_before = none6, none9, none
    for j in range(n):
        r = SPATIAL_ROWS * j
        tension, across_segment = load3(spec, work, r + TENSION), load(spec, work, r + ACROSS)
        plain, block_before = across_segment + own, scaled6(-own, skewed)
        after = none9
        u_next, per_length_next = u, per_length
        if j < n - 1 or settings.two_ends:
            r += SPATIAL_ROWS
            weight, per = load(spec, work, r + WEIGHT), load(spec, work, r + PER)
            if j < n - 1:
                u_next, per_length_next = load3(spec, work, r + UNIT), load(spec, work, r + PER_LENGTH)
            else:
                u_next = behind
            skewed = outer6(0.5 * per, cross(u, u_next))
            own = weight * (per_length * per_length)
            plain, block_before = plain + own, plus_scaled6(block_before, -own, skewed)
            if j < n - 1:
                k = weight * (per_length * per_length_next)
                after = mixed_block(k, u, u_next, dot(u, u_next), skewed)
                own = weight * (per_length_next * per_length_next)
            r -= SPATIAL_ROWS
        segment = diagonal_plus6(plain, plus6(block_before, outer6(stretch - plain, u)))
        to_next = minus_full_of(segment, plus9(between, after))
        if j == 0:
            force = scaled(splat(spec, -1.0), transposed_times9(to_next, known))
            force_after = transposed_times9(after, known)
        else:
            inertia, impulse = _point(spec, string, motion, j, settings)
            block = minus6(plus6(plus6(inertia, before), segment), twice_symmetric_part(between))
            solved = inverse6(spec, minus6(block, left))
            total = plus(plus(force, impulse), minus(tension, tension_before))
            to_next = minus9(to_next, left_between)
            # The block to the point after the next is -after.
            changed = times6(solved, total)
            next_share, after_share = symmetric_product(solved, to_next), symmetric_product(solved, after)
            left = plus6(left_after, transposed_product6(to_next, next_share))
            left_after = transposed_product6(after, after_share)
            left_between = scaled9(splat(spec, -1.0), transposed_product(to_next, after_share))
            force = minus(force_after, transposed_times9(to_next, changed))
            force_after = transposed_times9(after, changed)
            _store9(spec, work, r + NEXT, next_share)
            _store9(spec, work, r + OVER_NEXT, after_share)
            store3(spec, work, r + CHANGED, changed)
        before, between, tension_before = segment, after, tension
        u, per_length = u_next, per_length_next
    inertia, impulse = _point(spec, string, motion, n, settings)
    solved = inverse6(spec, minus6(plus6(inertia, before), left))
    return times6(solved, minus(plus(force, impulse), tension_before))


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
            after, change = change, own
            v_now = plus(load3(spec, v, 3 * i), change)
            store3(spec, v, 3 * i, v_now)
        else:
            change = clamp.dv
            v_now = plus(clamp.v, change)
        store3(spec, dv, 3 * i, change)
        store3(spec, d, 3 * i, plus_scaled(load3(spec, d, 3 * i), step, minus(v_after, v_now)))
        v_after = v_now
