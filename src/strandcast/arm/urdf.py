"""The URDF: limits by ElementTree (MuJoCo drops the speed limit), everything else through MuJoCo."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np

from strandcast.arm.settings import Payload
from strandcast.config.problems import SHOWN
from strandcast.errors import StrandcastError

MOVING_TYPES = ("revolute", "continuous", "prismatic")
MOST_BYTES = 8 << 20  # chosen; a URDF of 50 joints takes 50 KiB, its shapes are in other files
MOST_LEVELS = 32  # chosen; URDF has five, and MuJoCo reads each level by recursion
# For links without <inertial>: MuJoCo needs some, and it does not affect torques.
LEAST_MASS_KG = 1e-6
LEAST_INERTIA_KG_M2 = 1e-9
PLACEHOLDER_KG = 1e-3  # chosen: lighter links are placeholders


@dataclass(frozen=True)
class JointLimit:
    """The URDF's limits of one joint that can move; None where it gives none.

    `follows` names the joint that it mimics.
    """

    kind: str
    lower_rad: float | None
    upper_rad: float | None
    velocity_rad_s: float | None
    effort_n_m: float | None
    follows: str | None = None


def read_joint_limits(path: str | Path) -> dict[str, JointLimit]:
    """Return the limits of every joint that can move, by name, in the file's order."""
    joints = _root(path).findall("joint")
    for joint in joints:
        if joint.get("type") in ("floating", "planar"):
            what = f"joint {joint.get('name')!r} is of the type {joint.get('type')}"
            raise _refusal(path, what, 'give it type="fixed": the arm stands still')
    moving = [joint for joint in joints if joint.get("type") in MOVING_TYPES]
    return {joint.get("name", ""): _limit(joint, path) for joint in moving}


def _limit(joint: ElementTree.Element, path: str | Path) -> JointLimit:
    limit = joint.find("limit")

    def number(key: str) -> float | None:
        text = None if limit is None else limit.get(key)
        with suppress(ValueError):
            value = None if text is None else float(text)
            if value is None or not np.isnan(value):
                return value
        raise _refusal(path, f"joint {joint.get('name')!r}, limit {key}: {SHOWN.repr(text)} is not a number")

    kind, leader = str(joint.get("type")), joint.find("mimic")
    lower, upper = number("lower"), number("upper")
    if kind == "continuous" and not (lower or 0.0) < (upper or 0.0):  # exporters write 0 and 0
        lower = upper = None
    follows = None if leader is None else leader.get("joint")
    return JointLimit(kind, lower, upper, number("velocity"), number("effort"), follows)


def read_spec(path: str | Path) -> mujoco.MjSpec:
    """Return the URDF's links and joints to be built upon, without meshes and contact shapes.

    Fixed links are kept (MuJoCo would merge them into their parents), so that the clamp's link has a name.
    """
    root = _root(path)
    for link in root.iter("link"):
        for shape in link.findall("visual") + link.findall("collision"):
            link.remove(shape)
    for joint in root.findall("joint"):  # a follower is held at its angle; see `arm.checks.name_problems`
        for leader in joint.findall("mimic"):
            joint.remove(leader)
    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    except ValueError as error:
        raise _unreadable(path, error) from None
    spec.compiler.fusestatic = 0
    spec.compiler.boundmass = LEAST_MASS_KG
    spec.compiler.boundinertia = LEAST_INERTIA_KG_M2
    return spec


@lru_cache(maxsize=8)
def read_model(
    path: Path, sha256: str, upwards: tuple[float, ...], carrier: str = "", payload: Payload | None = None
) -> mujoco.MjModel:
    """Return the URDF's links and joints (see `read_spec`), compiled once, with a payload on a link.

    `sha256` is the file's, `upwards` a unit vector in the frame of the root, which may be mounted on a wall
    or a ceiling.
    """
    spec = read_spec(path)
    spec.option.gravity = spec.option.gravity[2] * np.array(upwards) + 0.0  # no zero below zero
    try:
        if payload is not None and payload.mass_kg > 0.0:
            least = [LEAST_INERTIA_KG_M2] * 3
            body = spec.body(carrier).add_body(pos=payload.centre_m)
            body.explicitinertial, body.mass, body.inertia = True, payload.mass_kg, least
            body.ipos = [0.0, 0.0, 0.0]
        return spec.compile()
    except ValueError as error:
        raise _unreadable(path, error) from None


def posed(model: mujoco.MjModel, positions: dict[str, float]) -> mujoco.MjData:
    """Return the model's kinematics with the named joints at `positions`, the others at zero."""
    data = mujoco.MjData(model)
    for name, value in positions.items():
        data.joint(name).qpos[0] = value
    mujoco.mj_kinematics(model, data)
    return data


def dofs_of(model: mujoco.MjModel, joints: Sequence[str]) -> np.ndarray:
    """Return the coordinates of hinges by name; their speeds have the same."""
    return np.array([int(model.joint(name).dofadr[0]) for name in joints])


def inverse_torques(
    data: mujoco.MjData, dofs: np.ndarray, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> np.ndarray:
    """Return torques (T, J) [N m] of hinges `dofs` (J,) of a posed model, by inverse dynamics from (T, J)."""
    torque = np.empty_like(q)
    for k in range(len(q)):
        data.qpos[dofs], data.qvel[dofs], data.qacc[dofs] = q[k], qd[k], qdd[k]
        mujoco.mj_inverse(data.model, data)
        torque[k] = data.qfrc_inverse[dofs]
    return torque


def _root(path: str | Path) -> ElementTree.Element:
    if not Path(path).is_file():
        raise StrandcastError(
            "SC-F202", "the URDF is not there", file=path, fix="give `urdf` a path beside the arm's file"
        )
    try:
        content = Path(path).read_bytes()
        if len(content) > MOST_BYTES:
            raise _refusal(path, f"is larger than {MOST_BYTES >> 20} MiB")
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        fix = "correct the URDF (a xacro must be expanded first)"
        raise _refusal(path, f"is not XML ({error})", fix) from None
    level = [root]
    for _ in range(MOST_LEVELS):
        level = [child for element in level for child in element]
    if level:
        raise _refusal(path, f"has more than {MOST_LEVELS} levels")
    if root.tag != "robot":
        raise _refusal(path, f"its root is <{root.tag}>, not <robot>", "give a URDF")
    return root


def _refusal(path: str | Path, what: str, fix: str = "correct the URDF") -> StrandcastError:
    return StrandcastError("SC-F202", what, file=path, fix=fix)


def _unreadable(path: str | Path, error: ValueError) -> StrandcastError:
    return _refusal(path, f"MuJoCo cannot read it as a URDF ({error})")


def owners(model: mujoco.MjModel, joints: tuple[str, ...]) -> np.ndarray:
    """Return the last of `joints` that turns each body, -1 for none."""
    bodies = [int(model.joint(name).bodyid[0]) for name in joints]
    owner = np.full(model.nbody, -1)
    for body in range(1, model.nbody):  # parents come before their children
        owner[body] = bodies.index(body) if body in bodies else owner[model.body_parentid[body]]
    return owner


def massless(model: mujoco.MjModel, joints: tuple[str, ...]) -> list[str]:
    """Return those of `joints` that turn links without mass, for which torques are unknown."""
    owner = owners(model, joints)
    return [name for j, name in enumerate(joints) if model.body_mass[owner == j].sum() < PLACEHOLDER_KG]
