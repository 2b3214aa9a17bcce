"""Strings given by what can be measured, moved at one end or at both: `strandcast.simulate`.

What the model holds, and where it ends: docs/how-to/simulate-a-string.md.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy

from strandcast.core.strings import CLAMP_OFFSET, DRAG_ALONG, FAR_OFFSET, REST_CURL, StringBatch, side
from strandcast.dynamics.batch import HANGING_AT_REST, HandPath, StringStart
from strandcast.dynamics.hand import places
from strandcast.dynamics.masses import mass_layout
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import DRAG_KG_M3, Array
from strandcast.dynamics.simulate import OK, STATUS, simulate_batch
from strandcast.dynamics.spatial.clamps import POSE, clamp_poses
from strandcast.errors import StrandcastError


class Material(NamedTuple):
    """What strings of a kind have in common, chosen between published values.

    Attributes
    ----------
    diameter_m
        Usual diameter [m].
    density_kg_m3
        Mass over the volume of a round rod of the diameter, air included.
    bending_pa
        Bending stiffness over that rod's second moment of area: fibres and wires slide on each other.
    damping_s
        Bending damping over stiffness [s].
    """

    diameter_m: float
    density_kg_m3: float
    bending_pa: float
    damping_s: float


MATERIALS = {
    "cotton cord": Material(0.004, 700.0, 1.5e5, 0.008),
    "rope": Material(0.010, 820.0, 6e5, 0.010),  # braided polyamide
    "cable": Material(0.006, 1900.0, 2e7, 0.015),  # stranded copper in PVC
    "fishing line": Material(0.0005, 1140.0, 2.5e9, 0.002),  # a solid polyamide rod
    "chain": Material(0.004, 2500.0, 0.0, 0.0),  # of steel links
}
WAVE_M_S = 100.0  # speed of waves along the string, at least; in real ones it is greater
# Largest share by which at rest the string itself, and its weights, stretch it. Steps of 1 ms follow a limp
# string that whips less well if it is stiffer still; chosen.
STRETCH, STRETCH_BY_WEIGHTS = 1e-3, 1e-4
STRETCH_DAMPING = 20.0  # N s/m/kg, within the range of the planner's prior
ALONG = 0.1  # drag along the string over that across it: mostly skin friction (chosen)
LONGEST_STEP_S = 1e-3  # smaller where an end moves by more than a quarter of a segment within it
FASTEST_M_S, LARGEST_TURN_RAD = 50.0, 1.0  # of an end, and of a direction between samples: no jump (chosen)
LONGEST_M = 50.0  # simulations count as failed where a point is 100 m away
# Over the length: the least span of the shape from which the rest shape is sought; and how far out of its
# plane a string may be, as it can pass two ends on either side. Chosen.
LEAST_SPAN, LEFT = 0.02, 1e-3


def simulate(
    time_s: Array,
    place_m: Array,
    *,
    length_m: float,
    material: str = "cotton cord",
    diameter_m: float | Array | None = None,
    mass_kg_m: float | Array | None = None,
    bending_n_m2: float | Array | None = None,
    damping_s: float | Array | None = None,
    rest_curl_rad_m: float | Array = 0.0,
    curl_towards: Array | None = None,
    weights: Sequence[tuple[float, float | Array]] = (),
    direction: Array | None = None,
    far_place_m: Array | None = None,
    far_direction: Array | None = None,
    out_time_s: Array | None = None,
    points: int = 40,
    gravity_m_s2: float = 9.81,
) -> Array:
    """Return the path of a string with one or two moving ends; it hangs at rest at first.

    Diameter, mass, stiffness, damping, curl and masses of weights may be arrays (B,): B strings are simulated
    at once, on all cores.

    Parameters
    ----------
    time_s
        (T,) increasing times [s].
    place_m
        (T, 2) x, y or (T, 3) x, y, z of the string's first end [m], y or z upwards; (B, T, 2 or 3): of each
        string. Between samples it moves along cubics.
    length_m
        Free length [m].
    material
        A name in `MATERIALS`, for what is not given.
    diameter_m, mass_kg_m, bending_n_m2, damping_s
        Diameter [m], mass per length [kg/m], bending stiffness [N m²], bending damping over stiffness [s].
    rest_curl_rad_m
        Bend of the string without load [rad/m], to the left; in space towards `curl_towards` (3,), at the
        first sample.
    weights
        Place along the string [m] and mass [kg] of each weight.
    direction
        (2 or 3,), (T, 2 or 3) or (B, T, 2 or 3) in which a clamp holds the string, away from the clamp; None:
        the string turns freely about its end.
    far_place_m, far_direction
        The same of the other end, if it is held; its direction also points away from its clamp.
    out_time_s
        (F,) times of the result [s]; None: `time_s`.
    points
        Number n of free mass points.
    gravity_m_s2
        Gravity [m/s²].

    Returns
    -------
    (F, n + 1, 2 or 3) or (B, F, n + 1, 2 or 3) places of the points [m], from the first end on; of several
    strings, NaN for one that failed.

    Raises
    ------
    StrandcastError
        SC-F003 an argument cannot be; SC-E003 the motion cannot be simulated.
    """
    if isinstance(points, bool) or not isinstance(points, int | np.integer) or not 4 <= points <= 400:
        raise _wrong("points", f"{points!r} cannot be", "give a whole number from 4 to 400")
    length, gravity = _one("length_m", length_m), _one("gravity_m_s2", gravity_m_s2)
    if length > LONGEST_M:
        raise _wrong("length_m", f"{length:g} m is too long", f"give up to {LONGEST_M:g} m")
    own = _numbers(material, diameter_m, mass_kg_m, bending_n_m2, damping_s)
    curl, (at_m, hung) = _number("rest_curl_rad_m", rest_curl_rad_m, -np.inf), _hung(weights, length)
    at_s, wanted = _times(time_s, time_s if out_time_s is None else out_time_s)
    ends = _ends(at_s, place_m, direction, far_place_m, far_direction)
    flat, two_ends, towards = ends[0].shape[-1] == 2, far_place_m is not None, None
    if curl.any() and not flat:
        towards = _beside(curl_towards, ends[1][..., 0, :])
    poses = _poses(at_s, ends, length, towards)
    numbers, several = _for_each((*own, curl, *hung), poses.shape[:-2])
    # All per kilogram of a point's mass; a clamp holds half a segment.
    (thick, mass, stiff, slow, curl, *hung), h_m = numbers, length / points
    joints = (stiff / (mass * h_m**2), stiff / (mass * h_m**2) * slow) * 2
    clamp = [2.0 * each * (direction is not None) for each in joints[:2]]
    pull = 9.81 * (length / STRETCH + sum(hung) / mass / STRETCH_BY_WEIGHTS)
    stretch = np.maximum(WAVE_M_S**2, pull) / h_m**2, np.full_like(mass, STRETCH_DAMPING)
    air = np.zeros_like(mass), DRAG_KG_M3 * thick / mass
    layout = mass_layout(length, points, at_m)
    masses = layout.plain + (np.reshape(hung, (-1, len(mass))) / (mass * h_m)).T @ layout.shares
    turns = {REST_CURL: curl, CLAMP_OFFSET: 0.5 * h_m * curl}
    turns |= {FAR_OFFSET: -0.5 * h_m * curl} if flat and far_direction is not None else {}
    in_space = two_ends or not flat
    values = {side(name, "left") if in_space else name: turn for name, turn in turns.items()}
    values[DRAG_ALONG] = np.full_like(mass, ALONG)
    strings = StringBatch(np.column_stack([*stretch, *joints, *air, *clamp]), masses, values)
    model = StringModel(length, points, dt_s=_step_s(ends, at_s, h_m), gravity_m_s2=gravity)
    start = HANGING_AT_REST
    if two_ends and poses.ndim == 2:
        start = StringStart(_between(poses[0, :3], poses[0, POSE : POSE + 3], length, points), settle=True)
    found, status = simulate_batch(model, strings, HandPath(at_s, poses), wanted, start)
    left = np.zeros(len(found), dtype=bool)
    if flat and in_space:
        left = np.abs(found[..., 1]).max(axis=(1, 2)) > LEFT * length
        found = found[..., ::2]
    failed = (status != OK) | left
    if failed.all():
        what = "the string leaves the plane" if left[0] else f"its simulation fails: {STATUS[int(status[0])]}"
        fix = "give paths in space" if left[0] else "check path and stiffness, or give more points"
        raise StrandcastError("SC-E003", what, field="place_m", fix=fix)
    found[failed] = np.nan
    return np.asarray(found if several else found[0])


def _numbers(material: str, diameter: Any, mass: Any, bending: Any, damping: Any) -> list[Array]:
    """Return diameter, mass per length, bending stiffness and damping, the material's for None."""
    if material not in MATERIALS:
        raise _wrong("material", f"{material!r} is not known", f"give one of {', '.join(MATERIALS)}")
    kind = MATERIALS[material]
    thick = _number("diameter_m", kind.diameter_m if diameter is None else diameter)
    solid = np.pi * thick**2 / 4
    return [
        thick,
        _number("mass_kg_m", kind.density_kg_m3 * solid if mass is None else mass),
        _number("bending_n_m2", kind.bending_pa * solid * thick**2 / 16 if bending is None else bending, 0.0),
        _number("damping_s", kind.damping_s if damping is None else damping, 0.0),
    ]


def _for_each(numbers: Sequence[Array], paths: tuple[int, ...]) -> tuple[list[Array], bool]:
    """Return the numbers of each string, (B,), and whether there are arrays of them, or of paths."""
    counts = {*map(np.shape, numbers), paths} - {()}
    if len(counts) > 1:
        what = f"there are arrays for {' and '.join(str(each[0]) for each in sorted(counts))} strings"
        raise _wrong("place_m", what, "give each array the same length")
    several, [count] = bool(counts), counts.pop() if counts else (1,)
    return [np.broadcast_to(each, count) for each in numbers], several


def _times(time_s: Any, out_time_s: Any) -> tuple[Array, Array]:
    """Return the times of the path and those of the result."""
    at_s, wanted = _array("time_s", time_s, 1), _array("out_time_s", out_time_s, 1)
    if len(at_s) < 2 or not np.all(np.diff(at_s) > 0):
        raise _wrong("time_s", "times do not increase, or are fewer than two", "give (T,) increasing numbers")
    if np.any(np.diff(wanted) < 0) or np.any(wanted < at_s[0]):
        raise _wrong("out_time_s", "times decrease, or precede the path", "give times within the path's")
    return at_s, wanted


def _hung(weights: Sequence[tuple[float, Any]], length_m: float) -> tuple[list[float], list[Array]]:
    """Return places [m] and masses [kg] of the weights."""
    try:
        pairs = [(float(place), mass) for place, mass in weights]
    except (TypeError, ValueError):
        raise _wrong("weights", f"{weights!r} cannot be", "give pairs of place and mass") from None
    if any(not 0.0 < place <= length_m for place, _ in pairs):
        raise _wrong("weights", "a weight is beside the string", f"give places up to {length_m:g} m")
    return [place for place, _ in pairs], [_number("weights", mass, 0.0) for _, mass in pairs]


def _ends(at_s: Array, place_m: Any, direction: Any, far_place_m: Any, far_direction: Any) -> list[Array]:
    """Return place [m] and direction of length one of each end that is held, each (…, T, 2 or 3)."""
    given = np.shape(_array("place_m", place_m))
    if len(given) not in (2, 3) or given[-2] != len(at_s) or given[-1] not in (2, 3):
        raise _wrong("place_m", f"its shape is {given}", f"give ({len(at_s)}, 2) or ({len(at_s)}, 3)")
    if (direction is None) != (far_direction is None) and far_place_m is not None:
        raise _wrong("far_direction", "only one end is clamped", "give both directions, or none")
    if far_place_m is None and far_direction is not None:
        raise _wrong("far_place_m", "it is not given, but far_direction is", "give both, or none")
    parts = {"place_m": place_m, "direction": direction}
    parts |= {} if far_place_m is None else {"far_place_m": far_place_m, "far_direction": far_direction}
    ends = []
    for name, value in parts.items():
        part = _array(name, -np.eye(given[-1])[-1] if value is None else value)
        try:
            part = np.broadcast_to(part, given)
        except ValueError:
            raise _wrong(name, f"its shape is {part.shape}", f"give {given}") from None
        if "direction" in name:
            size = np.linalg.norm(part, axis=-1, keepdims=True)
            if not size.all():
                raise _wrong(name, "it has no length at some time", "give a vector other than 0")
            part = part / size
            turned = np.arccos(np.clip((part[..., 1:, :] * part[..., :-1, :]).sum(axis=-1), -1.0, 1.0))
            _refuse_jump(name, at_s, turned, LARGEST_TURN_RAD, "turns by", "rad between samples")
        else:
            speed = np.linalg.norm(np.diff(part, axis=-2), axis=-1) / np.diff(at_s)
            _refuse_jump(name, at_s, speed, FASTEST_M_S, "moves at", "m/s")
        ends.append(np.ascontiguousarray(part))
    return ends


def _refuse_jump(name: str, at_s: Array, sizes: Array, most: float, what: str, unit: str) -> None:
    """Refuse a path with a jump: `sizes` (…, T - 1) are those of its steps."""
    if (sizes > most).any():
        k = int(np.argmax(sizes) % (len(at_s) - 1))
        what = f"it {what} {sizes.max():.3g} {unit} after {at_s[k]:g} s"
        raise _wrong(name, what, "check units, and the path for jumps; or sample it more often")


def _poses(at_s: Array, ends: list[Array], length_m: float, towards: Array | None) -> Array:
    """Return poses of the ends (…, T, 3, 9 or 18), as `HandPath` takes them."""
    flat = ends[0].shape[-1] == 2
    if len(ends) == 2 and flat:
        angle = np.unwrap(np.arctan2(ends[1][..., 1], ends[1][..., 0]))
        return np.concatenate([ends[0], angle[..., None]], axis=-1)
    if flat:  # only strings in space have two ends: y becomes z, and the normals stay in the plane
        ends = [np.insert(each, 1, 0.0, axis=-1) for each in ends]
    both = []
    for place_m, along in zip(ends[::2], ends[1::2], strict=True):
        shape = (-1, *place_m.shape[-2:])
        each = [clamp_poses(*pair) for pair in zip(place_m.reshape(shape), along.reshape(shape), strict=True)]
        pose = np.reshape(each, (*place_m.shape[:-1], POSE))
        normal, up = pose[..., 6:].copy(), np.cross(pose[..., 3:6], pose[..., 6:])
        if flat:
            pose[..., 6:] = np.cross([0.0, -1.0, 0.0], along)
        elif towards is not None:  # turned about the direction by one angle: without spin
            turn = np.arctan2(up[..., :1, :] @ towards, normal[..., :1, :] @ towards)[..., None]
            pose[..., 6:] = np.cos(turn) * normal + np.sin(turn) * up
        both.append(pose)
    if len(both) == 2:
        _refuse_far_apart(at_s, both, length_m)
    return np.concatenate(both, axis=-1)


def _refuse_far_apart(at_s: Array, both: list[Array], length_m: float) -> None:
    """Refuse ends that are farther apart than the string is long, also between samples."""
    fine_s, path = np.linspace(at_s[0], at_s[-1], 8 * len(at_s)), np.empty((2, 8 * len(at_s), 3))
    for pair in zip(*(each.reshape(-1, len(at_s), POSE) for each in both), strict=True):
        for pose, place_m in zip(pair, path, strict=True):
            places(at_s, np.ascontiguousarray(pose[:, :3]), fine_s, place_m)
        apart_m = np.linalg.norm(path[0] - path[1], axis=-1)
        if (apart_m > length_m).any():
            what = f"at {fine_s[np.argmax(apart_m)]:.3g} s the ends are {apart_m.max():.4g} m apart"
            fix = "correct the paths or the length"
            raise _wrong("far_place_m", f"{what}, and the string is {length_m:g} m long", fix)


def _between(first_m: Array, far_m: Array, length_m: float, points: int) -> Array:
    """Return points 1…n (n, 3) of a chain between two ends: a catenary, wider where they are side by side."""
    span, rise = far_m[:2] - first_m[:2], float(far_m[2] - first_m[2])
    level = float(np.linalg.norm(span))
    along = span / level if level > 0.0 else np.array([1.0, 0.0])
    wide, slack = max(level, LEAST_SPAN * length_m), np.sqrt(max(length_m**2 - rise**2, 0.0))
    share = np.arange(1, points + 1) / points
    if slack < wide * (1.0 + 1e-6):
        return np.asarray(first_m + share[:, None] * (far_m - first_m))
    size = wide / (2.0 * scipy.optimize.brentq(lambda z: np.sinh(z) / z - slack / wide, 1e-9, 20.0))
    begin = size * np.sinh(np.arctanh(rise / length_m) - wide / (2.0 * size))
    arc = begin + length_m * np.append(0.0, share)
    x, z = size * np.arcsinh(arc / size), np.hypot(size, arc)
    x, z = (x[1:] - x[0]) * level / wide + (wide - level) * np.sin(np.pi * share) * 0.5, z[1:] - z[0]
    return np.asarray(first_m + np.column_stack([x[:, None] * along, z]))


def _beside(curl_towards: Any, direction: Array) -> Array:
    """Return the vector (3,) towards which a string curls; it is not along the directions (…, 3)."""
    towards = np.zeros(3) if curl_towards is None else _array("curl_towards", curl_towards, 1)
    if towards.shape != (3,) or not np.cross(direction, towards).any(axis=-1).all():
        what = f"{curl_towards} does not say to which side the string curls"
        raise _wrong("curl_towards", what, "give a vector beside the direction, as [0, 1, 0]")
    return towards


def _step_s(ends: list[Array], at_s: Array, h_m: float) -> float:
    """Return the step [s] within which no end moves by more than a quarter of a segment."""
    fastest = max(
        float((np.linalg.norm(np.diff(end, axis=-2), axis=-1) / np.diff(at_s)).max()) for end in ends[::2]
    )
    return min(LONGEST_STEP_S, 0.25 * h_m / max(fastest, 1e-9))


def _array(name: str, value: Any, axes: int | None = None) -> Array:
    """Return finite numbers."""
    try:
        given = np.asarray(value, float)
    except (TypeError, ValueError):
        raise _wrong(name, "it is no array of numbers", "give numbers, in rows of the same length") from None
    if axes is not None and given.ndim != axes:
        raise _wrong(name, f"its shape is {given.shape}", f"give {axes} axis")
    if not given.size or not np.isfinite(given).all():
        raise _wrong(name, "some numbers are missing", "leave their samples out, or fill the gaps")
    return given


def _number(name: str, value: Any, least: float = 1e-12) -> Array:
    """Return one finite number, or one of each string, at least so great."""
    try:
        given = np.asarray(value, float)
    except (TypeError, ValueError):
        given = np.array(np.nan)
    if given.ndim > 1 or not given.size or not np.isfinite(given).all() or (given < least).any():
        words = {0.0: " from 0 on", -np.inf: ""}.get(least, " above 0")
        raise _wrong(name, f"{value!r} cannot be", f"give one number{words}, or one for each string")
    return given


def _one(name: str, value: Any) -> float:
    given = _number(name, value)
    if given.ndim:
        raise _wrong(name, f"{value!r} cannot be", "give one number for all strings")
    return float(given)


def _wrong(field: str, what: str, fix: str) -> StrandcastError:
    return StrandcastError("SC-F003", what, field=field, fix=fix)
