"""Serves a simulated Franka controller on a loopback address; run by franka-sim's own Python, never imported.

Its MuJoCo model is made here from the URDF in its wheel; the one that it would download is not needed.
The URDF has no rotor inertia, without which the light last joint rattles under position control.
"""

import logging
import os
import sys
import threading
import time
import xml.etree.ElementTree as ElementTree
from contextlib import suppress
from pathlib import Path

import franka_sim
import mujoco
from franka_sim.mujoco_franka_sim import MujocoFrankaSim
from franka_sim.server.constants import RobotMode

NICE = -10  # a controller has a computer of its own
ARMATURE_KG_M2 = (0.2, 0.2, 0.2, 0.2, 0.1, 0.1, 0.1)
DAMPING_N_M_S = 1.0


def write_model(path: Path) -> None:
    """Write the wheel's FR3 as an MJCF without pictures and contact shapes."""
    urdf = Path(franka_sim.__file__).parent / "models" / "fr3.urdf"
    root = ElementTree.parse(urdf).getroot()
    for link in root.iter("link"):
        for shape in link.findall("visual") + link.findall("collision"):
            link.remove(shape)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    for joint, armature in zip(spec.joints, ARMATURE_KG_M2, strict=True):
        joint.armature, joint.damping = armature, DAMPING_N_M_S
    spec.compile()
    path.write_text(spec.to_xml())


def end_in_time(parent: int, longest_s: float) -> None:
    """End the process when its parent has ended, or after so long: no client waits for ever."""
    deadline = time.monotonic() + longest_s
    while os.getppid() == parent and time.monotonic() < deadline:
        time.sleep(0.5)
    os._exit(1)


class Controller(franka_sim.FrankaSimServer):
    """The server, with an arm that stays in a reflex when a client leaves, until someone recovers it."""

    def reset_state(self) -> None:
        """Forget the client, not the reflex."""
        before = self.robot_state.state
        super().reset_state()
        if before["robot_mode"] == RobotMode.kReflex:
            self.robot_state.state |= {
                name: before[name] for name in ("robot_mode", "errors", "reflex_reason")
            }


def main(host: str, model: Path, longest_s: float) -> None:
    """Serve until killed, with the controller's reflexes on limits and lost commands switched on."""
    threading.Thread(target=end_in_time, args=(os.getppid(), longest_s), daemon=True).start()
    with suppress(PermissionError):
        os.nice(NICE)
    write_model(model)
    server = Controller(
        host=host,
        physics_sim=MujocoFrankaSim(model_path=model),
        enable_gripper=False,
        enforce_comm_constraints=True,
        enforce_motion_limits=True,
    )
    server.start()


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO)
    main(sys.argv[1], Path(sys.argv[2]), float(sys.argv[3]))
