"""The planar chain of a throw, taken from the URDF's model."""

import mujoco
import numpy as np

from strandcast.arm.kinematics import PlanarChain
from strandcast.arm.urdf import posed
from strandcast.core.pose import wrapped

# Chosen: beyond rounding, below any real misalignment.
AXIS_TOLERANCE = 1e-6
SHORTEST_LINK_M = 1e-9


def joints_out_of_plane(
    model: mujoco.MjModel, joints: tuple[str, ...], held: dict[str, float], plane: np.ndarray
) -> dict[str, float]:
    """Return the joints whose axes are not normal to the plane, with their tilt [rad]."""
    data = posed(model, held)
    normal = np.cross(plane[0], plane[1])
    tilts = {name: float(np.arccos(min(1.0, abs(data.joint(name).xaxis @ normal)))) for name in joints}
    return {name: tilt for name, tilt in tilts.items() if np.sin(tilt) > AXIS_TOLERANCE}


def joints_out_of_order(model: mujoco.MjModel, joints: tuple[str, ...], link: str) -> list[str]:
    """Return the joints that do not lie, in the order given, on the way from the base to the link."""
    on_the_way = [model.body(b).name for b in _ancestors(model, model.body(link).id)]
    bodies = [model.body(model.joint(name).bodyid[0]).name for name in joints]
    places = [on_the_way.index(body) if body in on_the_way else -1 for body in bodies]
    return [
        name
        for i, (name, place) in enumerate(zip(joints, places, strict=True))
        if place < 0 or (i > 0 and place <= places[i - 1])
    ]


def extract_chain(
    model: mujoco.MjModel, joints: tuple[str, ...], held: dict[str, float], plane: np.ndarray, link: str
) -> PlanarChain:
    """Return the planar chain of the moving joints up to the link that carries the clamp.

    Parameters
    ----------
    joints
        Names of the moving joints, from the base to the hand; all normal to the plane.
    held
        Angle of each other joint [rad].
    plane
        (2, 3) unit vectors of the plane's x and y axes in the base's frame.
    link
        Name of the link that carries the clamp.
    """
    data = posed(model, held)
    points = np.array([data.joint(name).xanchor for name in joints] + [data.body(link).xpos]) @ plane.T
    steps = np.diff(points, axis=0)
    lengths = np.hypot(*steps.T)
    # A link of zero length continues in the direction of the link before.
    directions = np.zeros(len(joints) + 1)
    for j, (step, length) in enumerate(zip(steps, lengths, strict=True)):
        directions[j + 1] = np.arctan2(step[1], step[0]) if length > SHORTEST_LINK_M else directions[j]
    angles = np.diff(directions)
    signs = np.array([np.sign(data.joint(name).xaxis @ np.cross(plane[0], plane[1])) for name in joints])
    return PlanarChain(points[0], lengths, wrapped(angles), signs)


def _ancestors(model: mujoco.MjModel, body: int) -> list[int]:
    chain = [body]
    while chain[-1] != 0:
        chain.append(int(model.body_parentid[chain[-1]]))
    return chain[::-1]
