"""Strings given by what can be measured, moved at one end or at both: `strandcast.simulate`.

What the model holds, and where it ends: docs/how-to/simulate-a-string.md.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from strandcast.core.strings import DRAG_ALONG, REST_CURL, StringBatch, side
from strandcast.dynamics.batch import HandPath
from strandcast.dynamics.masses import mass_layout
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import DRAG_KG_M3, Array
from strandcast.dynamics.simulate import OK, STATUS, simulate_batch
from strandcast.dynamics.spatial.clamps import clamp_poses
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
WAVE_M_S = 100.0  # speed of waves along a string without weights, at least; in real ones it is greater
STRETCH = 1e-3  # largest share by which the string and its weights, at rest, stretch it (chosen)
STRETCH_DAMPING = 20.0  # N s/m/kg, within the range of the planner's prior
ALONG = 0.1  # drag along the string over that across it: mostly skin friction (chosen)
LONGEST_STEP_S, SHORTEST_STEP_S = 1e-3, 1e-5  # within which a step moves the ends by a quarter of a segment


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
    weights: Sequence[tuple[float, float | Array]] = (),
    direction: Array | None = None,
    far_place_m: Array | None = None,
    far_direction: Array | None = None,
    out_time_s: Array | None = None,
    points: int = 40,
    gravity_m_s2: float = 9.81,
) -> Array:
    """Return the path of a string that hangs at rest at first, and whose end is moved.

    Numbers of the string may be arrays (B,): B strings are simulated at once, on all cores.

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
        Bend of the string without load [rad/m]: to the left; of one that hangs in space, towards -y.
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
    strings, NaN from where one diverged.

    Raises
    ------
    StrandcastError
        SC-F003 an argument cannot be; SC-E003 the motion cannot be simulated.
    """
    if material not in MATERIALS:
        raise _wrong("material", f"{material!r} is not known", f"give one of {', '.join(MATERIALS)}")
    kind, h_m = MATERIALS[material], float(_number("length_m", length_m)) / max(points, 1)
    if not 4 <= points <= 400:
        raise _wrong("points", f"{points} is not between 4 and 400", "40 suit most strings")
    thick = _number("diameter_m", kind.diameter_m if diameter_m is None else diameter_m)
    mass = _number("mass_kg_m", kind.density_kg_m3 * np.pi * thick**2 / 4 if mass_kg_m is None else mass_kg_m)
    stiff = _number(
        "bending_n_m2", kind.bending_pa * np.pi * thick**4 / 64 if bending_n_m2 is None else bending_n_m2, 0.0
    )
    slow = _number("damping_s", kind.damping_s if damping_s is None else damping_s, 0.0)
    hung = [_number("weights", kilograms, 0.0) for _, kilograms in weights]
    if any(not 0.0 < place <= length_m for place, _ in weights):
        raise _wrong("weights", "a weight is beside the string", f"give places up to {length_m:g} m")
    poses, ends = _poses(time_s, place_m, direction, far_place_m, far_direction, float(length_m))
    curl = _number("rest_curl_rad_m", rest_curl_rad_m, -np.inf)
    numbers = thick, mass, stiff, slow, curl, *hung
    counts = {*map(np.shape, numbers), poses.shape[: poses.ndim - 2]} - {()}
    if len(counts) > 1:
        what = f"there are arrays for {' and '.join(str(each[0]) for each in sorted(counts))} strings"
        raise _wrong("place_m", what, "give each array the same length")
    given_many, [count] = bool(counts), counts.pop() if counts else (1,)
    thick, mass, stiff, slow, curl, *hung = (np.broadcast_to(each, count) for each in numbers)
    model = StringModel(float(length_m), points, dt_s=_step_s(ends, time_s, h_m), gravity_m_s2=gravity_m_s2)
    # All per kilogram of a point's mass; a clamp holds half a segment.
    bending = stiff / (mass * h_m**2)
    clamp = bending * 2.0 * (direction is not None)
    drag = DRAG_KG_M3 * thick / mass
    load = 9.81 * (length_m + sum(hung) / mass) / STRETCH
    stretch = np.maximum(WAVE_M_S**2, load) / h_m**2, np.full(count, STRETCH_DAMPING)
    joints = (bending, bending * slow) * 2
    columns = (*stretch, *joints, 0.0 * drag, drag, clamp, clamp * slow)
    layout = mass_layout(float(length_m), points, [place for place, _ in weights])
    masses = layout.plain + (np.reshape(hung, (-1, count)) / (mass * h_m)).T @ layout.shares
    in_space = poses.shape[-1] > 3
    values = {side(REST_CURL, "left") if in_space else REST_CURL: curl, DRAG_ALONG: np.full(count, ALONG)}
    strings = StringBatch(np.column_stack(columns), masses, values)
    wanted = np.asarray(time_s if out_time_s is None else out_time_s, float)
    if not (wanted.ndim == 1 and np.all(np.diff(wanted) >= 0) and np.all(wanted >= np.min(time_s))):
        raise _wrong("out_time_s", "times decrease, or precede the path", "give times within the path's")
    found, status = simulate_batch(model, strings, HandPath(np.asarray(time_s, float), poses), wanted)
    if in_space and np.shape(place_m)[-1] == 2:
        found = found[..., ::2]
    if (status != OK).all():
        what = f"the string's simulation fails: {STATUS[int(status[0])]}"
        raise StrandcastError(
            "SC-E003", what, field="place_m", fix="check the path for jumps, and the stiffness"
        )
    return np.asarray(found if given_many else found[0])


def _poses(
    time_s: Array,
    place_m: Array,
    direction: Array | None,
    far_place_m: Array | None,
    far_direction: Array | None,
    length_m: float,
) -> tuple[Array, list[Array]]:
    """Return the poses of the ends, (…, T, 3, 9 or 18), and their places (…, T, 3)."""
    at = np.asarray(time_s, float)
    if at.ndim != 1 or len(at) < 2 or not np.isfinite(at).all() or not np.all(np.diff(at) > 0):
        raise _wrong("time_s", "times do not increase, or are fewer than two", "give (T,) increasing numbers")
    given = np.shape(place_m)
    if len(given) not in (2, 3) or given[-2] != len(at) or given[-1] not in (2, 3):
        raise _wrong("place_m", f"its shape is {given}", f"give ({len(at)}, 2) or ({len(at)}, 3)")
    if (direction is None) != (far_direction is None) and far_place_m is not None:
        raise _wrong("far_direction", "only one end is clamped", "give both directions, or none")
    down = -np.eye(given[-1])[-1]
    first = _finite("place_m", place_m, given)
    along = _finite("direction", down if direction is None else direction, given)
    if far_place_m is None:
        if given[-1] == 3:
            return _clamps(first, along), [first]
        angle = np.unwrap(np.arctan2(along[..., 1], along[..., 0]))
        return np.concatenate([first, angle[..., None]], axis=-1), [first]
    far = _finite("far_place_m", far_place_m, given)
    back = _finite("far_direction", down if far_direction is None else far_direction, given)
    apart_m = np.linalg.norm(first - far, axis=-1)
    if (apart_m > length_m).any():
        what = f"the ends are {apart_m.max():.4g} m apart, and the string is {length_m:g} m long"
        at_s = at[int(np.argmax(apart_m) % len(at))]
        raise _wrong("far_place_m", f"at {at_s:g} s {what}", "correct the paths or the length")
    if given[-1] == 3:
        return np.concatenate([_clamps(first, along), _clamps(far, back)], axis=-1), [first, far]
    # Only strings in space have two ends: y becomes z, and the normals stay in the plane.
    sides = [np.stack([-each[..., 1], each[..., 0]], axis=-1) for each in (along, back)]
    parts = [first, along, sides[0], far, back, sides[1]]
    poses = np.zeros((*given[:-1], 18))
    poses[..., 0::3], poses[..., 2::3] = (np.stack([part[..., k] for part in parts], axis=-1) for k in (0, 1))
    return poses, [first, far]


def _clamps(place_m: Array, along: Array) -> Array:
    """Return poses (…, T, 9) of clamps whose roll follows from their directions."""
    try:
        if place_m.ndim == 2:
            return clamp_poses(place_m, along)
        return np.stack([clamp_poses(*each) for each in zip(place_m, along, strict=True)])
    except ValueError as error:
        raise _wrong("direction", str(error), "give directions that turn by less than half a turn") from None


def _step_s(ends: list[Array], time_s: Array, h_m: float) -> float:
    """Return the step [s] within which no end moves by more than a quarter of a segment."""
    gap_s = np.diff(np.asarray(time_s, float))
    speed = np.max([(np.linalg.norm(np.diff(end, axis=-2), axis=-1) / gap_s) for end in ends], axis=0)
    fastest = float(speed.max())
    step_s = min(LONGEST_STEP_S, 0.25 * h_m / max(fastest, 1e-9))
    if step_s < SHORTEST_STEP_S:
        k = int(np.argmax(speed) % len(gap_s))
        what = f"an end moves at {fastest:.3g} m/s after {time_s[k]:g} s"
        raise StrandcastError("SC-E003", what, field="place_m", fix="check units, and the path for jumps")
    return step_s


def _number(name: str, value: Any, least: float = 1e-12) -> Array:
    """Return one finite number, or one of each string, at least so great."""
    given = np.asarray(value, float)
    if given.ndim > 1 or not np.isfinite(given).all() or (given < least).any():
        words = {0.0: " from 0 on", -np.inf: ""}.get(least, " above 0")
        raise _wrong(name, f"{value!r} cannot be", f"give one number{words}, or one for each string")
    return given


def _finite(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Return finite numbers in this shape."""
    try:
        given = np.broadcast_to(np.asarray(value, float), shape)
    except ValueError:
        raise _wrong(name, f"its shape is {np.shape(value)}", f"give {shape}") from None
    if not np.isfinite(given).all():
        raise _wrong(name, "some numbers are missing", "leave their samples out, or fill the gaps")
    if "direction" in name and not given.any(axis=-1).all():
        raise _wrong(name, "it has no length at some time", "give a vector other than 0")
    return np.ascontiguousarray(given)


def _wrong(field: str, what: str, fix: str) -> StrandcastError:
    return StrandcastError("SC-F003", what, field=field, fix=fix)
