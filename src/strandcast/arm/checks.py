"""Problems of an arm's file, each in one sentence."""

from itertools import pairwise

import mujoco
import numpy as np

from strandcast.arm.settings import AnyArmKeys, ArmKeys, SpatialArmKeys
from strandcast.arm.urdf import JointLimit, massless, posed

Problem = tuple[str, str, str]  # field, what is wrong, fix
AXIS_TOLERANCE = 1e-6  # sine of a joint's tilt: beyond rounding, below any real misalignment; chosen
TURNS = 4.0 * np.pi  # the most that a joint without a range is held at [rad]: degrees are more; chosen
EACH_JOINT = "one number per joint of throw.joints"
HELD_BEYOND = 1e-3  # of a range, by rounding [rad or m]; chosen


def name_problems(keys: AnyArmKeys, urdf: dict[str, JointLimit], model: mujoco.MjModel) -> list[Problem]:
    """Return joints and links that the URDF does not have, or that the file does not name."""
    found = []
    for where, names in (("throw.joints", keys.throw.joints), ("throw.held", list(keys.throw.held))):
        found += [
            (where, f"the URDF has no moving joint {name!r}", f"one of: {', '.join(urdf)}")
            for name in names
            if name not in urdf
        ]
    both = set(keys.throw.joints) & set(keys.throw.held)
    found += [("throw.held", f"{name!r} is in throw.joints too", "name it once") for name in sorted(both)]
    twice = {name for name in keys.throw.joints if keys.throw.joints.count(name) > 1}
    found += [("throw.joints", f"{name!r} is named twice", "name it once") for name in sorted(twice)]
    following = {name: urdf[name].follows for name in urdf if urdf[name].follows is not None}
    found += [
        ("throw.joints", f"{name!r} follows {leader!r} (<mimic>)", "only joints that move alone can throw")
        for name, leader in following.items()
        if name in keys.throw.joints or leader in keys.throw.joints
    ]
    forgotten = [name for name in urdf if name not in keys.throw.joints and name not in keys.throw.held]
    found += [
        ("throw.held", f"joint {name!r} of the URDF neither moves nor is held", f"add `{name} = <rad>`")
        for name in forgotten
    ]
    links = [model.body(b).name for b in range(1, model.nbody)]
    if keys.clamp.link not in links:
        found.append(
            ("clamp.link", f"the URDF has no link {keys.clamp.link!r}", f"one of: {', '.join(links)}")
        )
    return found


def number_problems(keys: AnyArmKeys, urdf: dict[str, JointLimit]) -> list[Problem]:
    """Return lists of the wrong length, limits missing from the URDF, reversed ranges."""
    count = len(keys.throw.joints)
    found = [
        (f"{table}.{key}", f"{len(values)} numbers for {count} moving joints", EACH_JOINT)
        for table in ("limits", "start", "stop", "guard", "servo")
        for key, values in getattr(keys, table)
        if isinstance(values, list) and len(values) != count
    ]
    for name in keys.throw.joints:
        found += _limit_problems(keys, name, urdf[name])
    for name, angle in keys.throw.held.items():
        low, high = urdf[name].lower_rad, urdf[name].upper_rad
        low, high = -TURNS if low is None else low, TURNS if high is None else high
        if not low - HELD_BEYOND <= angle <= high + HELD_BEYOND:
            what = f"{angle:g} is not within {low:g} and {high:g}"
            found.append((f"throw.held.{name}", what, "give its angle in rad (a sliding joint's in m)"))
    for axis, pair in keys.workspace.model_dump().items():
        if pair[0] >= pair[1]:
            found.append(
                (f"workspace.{axis}", f"{pair[0]} is not below {pair[1]}", "give the lower end first")
            )
    return found


def _limit_problems(keys: AnyArmKeys, name: str, limit: JointLimit) -> list[Problem]:
    where = f"{keys.urdf} <joint name={name!r}> <limit>"
    if limit.kind == "prismatic":
        return [("throw.joints", f"{name!r} slides", "only turning joints can move in a throw")]
    missing = [
        key
        for key, value in (("velocity", limit.velocity_rad_s), ("effort", limit.effort_n_m))
        if value is None
    ]
    if limit.kind == "revolute":
        missing += [
            key for key, value in (("lower", limit.lower_rad), ("upper", limit.upper_rad)) if value is None
        ]
    found = [(where, f"has no {key}", "add it to the URDF; no motion is planned without") for key in missing]
    if missing:
        return found
    above = {"velocity": limit.velocity_rad_s} | ({"effort": limit.effort_n_m} if keys.margins.torque else {})
    found += [
        (where, f"{key}={value:g} is not above 0", "give what the joint can do; exporters write 0")
        for key, value in above.items()
        if value is not None and not value > 0.0
    ]
    room = 2.0 * keys.margins.position_rad
    if None not in (limit.lower_rad, limit.upper_rad) and not limit.upper_rad - limit.lower_rad > room:  # type: ignore[operator]
        found.append((where, f"leaves no range within margins.position_rad = {room / 2}", "widen it"))
    return found


def mass_problems(keys: AnyArmKeys, model: mujoco.MjModel) -> list[Problem]:
    """Return limits of power and momentum that depend on masses which the URDF does not give."""
    names = massless(model, tuple(keys.throw.joints))
    what = f"not known: the URDF gives no mass to what {', '.join(names)} turns"
    return [
        (f"limits.{key}", what, "give the URDF <inertial>, or leave the limit out")
        for key in ("power_w", "momentum_kg_m_s")
        if names and getattr(keys.limits, key)
    ]


def geometry_problems(keys: ArmKeys, model: mujoco.MjModel) -> list[Problem]:
    """Return an invalid plane, joints that do not turn in it, joints out of order."""
    plane = keys.throw.plane()
    if not np.allclose(plane @ plane.T, np.eye(2), atol=1e-6):
        return [("throw.plane_x, plane_y", "are not at right angles", "give two perpendicular directions")]
    data, normal = posed(model, keys.throw.held), np.cross(*plane)
    tilts = {
        name: float(np.arccos(min(1.0, abs(data.joint(name).xaxis @ normal)))) for name in keys.throw.joints
    }
    return [
        (
            "throw.joints",
            f"the axis of {name!r} is {np.degrees(tilt):.1f}° off the plane's normal",
            "choose joints that are parallel, or correct throw.plane_x, plane_y or throw.held",
        )
        for name, tilt in tilts.items()
        if np.sin(tilt) > AXIS_TOLERANCE
    ] + order_problems(keys, model)


def problems_in_space(keys: SpatialArmKeys, model: mujoco.MjModel) -> list[Problem]:
    """Return joints out of order, and a clamp without a direction."""
    found = order_problems(keys, model)
    if not np.linalg.norm(keys.clamp.direction) > 0.0:
        found.append(("clamp.direction", "has no length", "give a direction in the frame of clamp.link"))
    return found


def order_problems(keys: AnyArmKeys, model: mujoco.MjModel) -> list[Problem]:
    """Return joints that are not named from the base to the hand."""
    on_the_way, body = set(), model.body(keys.clamp.link).id
    while body != 0:
        on_the_way.add(body)
        body = int(model.body_parentid[body])
    bodies = [int(model.joint(name).bodyid[0]) for name in keys.throw.joints]
    places = [body if body in on_the_way else 0 for body in bodies]  # parents come before their children
    return [
        (
            "throw.joints",
            f"{name!r} is not on the way from the joint before it to {keys.clamp.link!r}",
            "name the joints from the base to the hand",
        )
        for name, (before, place) in zip(keys.throw.joints, pairwise([0, *places]), strict=True)
        if place <= before
    ]
