"""Motion files from samples of the joints."""

import numpy as np

from strandcast.arm.load import PlanarArm
from strandcast.records.motion import Motion, Robot, StartPosture, points_of


def motion_of(arm: PlanarArm, ns: np.ndarray, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> Motion:
    """Return a motion of points at times (T,) [ns], with angles, speeds and accelerations (T, J)."""
    return Motion(
        experiment="e",
        trial=1,
        target_m=[0.5, 0.5],
        robot=Robot(name=arm.name, file_sha256=arm.sha256, urdf_sha256=arm.urdf_sha256),
        joint_names=list(arm.joints),
        start=StartPosture(positions_rad=q[0].tolist(), tolerance_rad=arm.start_tolerance_rad.tolist()),
        bezier=None,
        points=points_of(ns, q, qd, qdd),
        predicted=None,
        provenance=None,
    )


def swing(arm: PlanarArm, start: np.ndarray, by: np.ndarray | float, duration_s: float) -> Motion:
    """Return the quintic from rest to rest, a point every 2 ms and one at the end."""
    ns = np.append(np.arange(0, round(duration_s * 1e9), 2_000_000), round(duration_s * 1e9))
    s = (ns * 1e-9 / duration_s)[:, None]
    way = by * np.ones(len(arm.joints))
    return motion_of(
        arm,
        ns,
        start + way * s**3 * (10 - 15 * s + 6 * s**2),
        way * 30 * s**2 * (1 - s) ** 2 / duration_s,
        way * 60 * s * (1 - s) * (1 - 2 * s) / duration_s**2,
    )
