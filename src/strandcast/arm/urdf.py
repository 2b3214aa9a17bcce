"""The URDF: limits by ElementTree (MuJoCo drops the speed limit), everything else through MuJoCo."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from strandcast.errors import StrandcastError

MOVING_TYPES = ("revolute", "continuous", "prismatic")
# Enough for links without <inertial>, which serve kinematics and have no part in torques.
LEAST_MASS_KG = 1e-6
LEAST_INERTIA_KG_M2 = 1e-9


@dataclass(frozen=True)
class JointLimit:
    """What the URDF says of one joint that can move; None where it says nothing."""

    kind: str
    lower_rad: float | None
    upper_rad: float | None
    velocity_rad_s: float | None
    effort_n_m: float | None


def read_joint_limits(path: str | Path) -> dict[str, JointLimit]:
    """Return the limits of every joint that can move, by name, in the file's order."""
    joints = [joint for joint in _root(path).findall("joint") if joint.get("type") in MOVING_TYPES]
    return {joint.get("name", ""): _limit(joint) for joint in joints}


def _limit(joint: ElementTree.Element) -> JointLimit:
    limit = joint.find("limit")

    def number(key: str) -> float | None:
        text = None if limit is None else limit.get(key)
        return None if text is None else float(text)

    return JointLimit(
        str(joint.get("type")), number("lower"), number("upper"), number("velocity"), number("effort")
    )


@dataclass(frozen=True)
class Burden:
    """A mass [kg] that a link carries, at a place in its frame [m]."""

    link: str
    mass_kg: float
    centre_m: tuple[float, float, float]


def read_model(path: str | Path, burden: Burden | None = None) -> mujoco.MjModel:
    """Compile the URDF's links and joints, without its pictures and contact shapes, with a burden besides.

    Fixed links are kept (MuJoCo would melt them into their parents), so that the clamp's link can be named.
    """
    root = _root(path)
    for link in root.iter("link"):
        for shape in link.findall("visual") + link.findall("collision"):
            link.remove(shape)
    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
        spec.compiler.fusestatic = 0
        spec.compiler.boundmass = LEAST_MASS_KG
        spec.compiler.boundinertia = LEAST_INERTIA_KG_M2
        if burden is not None and burden.mass_kg > 0.0:
            least = [LEAST_INERTIA_KG_M2] * 3
            body = spec.body(burden.link).add_body(pos=burden.centre_m)
            body.explicitinertial, body.mass, body.inertia = True, burden.mass_kg, least
            body.ipos = [0.0, 0.0, 0.0]
        return spec.compile()
    except ValueError as error:
        raise StrandcastError(
            "SC-F202", f"MuJoCo cannot read it as a URDF ({error})", file=path, fix="mend the URDF"
        ) from None


def joint_names(model: mujoco.MjModel) -> list[str]:
    """Return the names of the model's joints, in the order of its coordinates."""
    return [model.joint(j).name for j in range(model.njnt)]


def coordinates(model: mujoco.MjModel, positions: dict[str, float]) -> np.ndarray:
    """Return the model's coordinate vector with the named joints at `positions`, the others at zero."""
    q = np.zeros(model.nq)
    for name, value in positions.items():
        q[model.joint(name).qposadr[0]] = value
    return q


def _root(path: str | Path) -> ElementTree.Element:
    try:
        root = ElementTree.fromstring(Path(path).read_bytes())
    except FileNotFoundError:
        raise StrandcastError(
            "SC-F201", "the URDF is not there", file=path, fix="give `urdf` a path beside the arm's file"
        ) from None
    except ElementTree.ParseError as error:
        raise StrandcastError(
            "SC-F202",
            f"is not XML ({error})",
            file=path,
            fix="mend the URDF (a xacro must be expanded first)",
        ) from None
    if root.tag != "robot":
        raise StrandcastError(
            "SC-F202", f"its root is <{root.tag}>, not <robot>", file=path, fix="give a URDF"
        )
    return root
