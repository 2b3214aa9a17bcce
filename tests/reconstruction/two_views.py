"""Two cameras that film a string that leaves the plane: our own simulator's, in space."""

from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from strandcast.camera.mapping import distort, pixel_to_metre
from strandcast.core.strings import StringBatch
from strandcast.dynamics.batch import HandPath
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.simulate import simulate_batch
from strandcast.dynamics.spatial.clamps import clamp_poses
from strandcast.reconstruction.views import StringView
from strandcast.records.alignment import Alignment
from strandcast.records.camera import Camera, Lens
from strandcast.records.observations import StringPixels

LENGTH_M, NODES, POINTS = 0.5, 32, 16
TO_PLANE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # z up to y up, z to the camera
DISTANCE_M, SECONDS = 2.2, 1.2
# k_s, c_s, k_h, c_h, k_sh, c_sh, C_c1, C_c2, k_ph, c_ph over the mass of a point
STRING = np.array([3e7, 1e3, 10.0, 0.05, 10.0, 0.05, 0.05, 0.2, 10.0, 0.05])


def camera_at(turn_rad: float, lift_rad: float = 0.0, offset_m: float = 0.0) -> Camera:
    """A camera that looks at the world's origin, from the right and above, through a lens with distortion."""
    back = np.array(
        [np.sin(turn_rad) * np.cos(lift_rad), np.sin(lift_rad), np.cos(turn_rad) * np.cos(lift_rad)]
    )
    right = np.cross([0.0, 1.0, 0.0], back)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, -np.cross(back, right), -back])
    return Camera(
        lens=Lens(
            width_px=1280,
            height_px=1024,
            rms_px=0.1,
            distortion=[-0.1, 0.03, 4e-4, -3e-4, 0.0],
            matrix=[[1900.0, 0.0, 639.5], [0.0, 1902.0, 511.5], [0.0, 0.0, 1.0]],
        ),
        rotation=rotation.tolist(),
        translation_m=[0.0, 0.0, DISTANCE_M],
        plane_rms_px=0.1,
        plane_markers=[],
        string_offset_m=offset_m,
        scale_m_per_px=DISTANCE_M / 1900.0,
        source="given",
    )


LEFT, RIGHT = camera_at(-0.35), camera_at(0.35, 0.1)


@cache
def _simulated(sway_m: float) -> CubicSpline:
    time_s = np.arange(0.0, SECONDS + 1e-9, 1e-3)
    ease = np.minimum(time_s / 0.3, 1.0) ** 2
    hand_m = np.column_stack(
        [0.15 * ease * np.sin(9.0 * time_s), sway_m * ease * np.sin(6.5 * time_s + 0.4), 0.25 + 0.0 * time_s]
    )
    direction = np.column_stack([0.4 * ease * np.sin(9.0 * time_s), 0.0 * time_s, -1.0 + 0.0 * time_s])
    path = HandPath(time_s, clamp_poses(hand_m, direction))
    strings = StringBatch(STRING[None], np.ones((1, NODES)))
    points, status = simulate_batch(StringModel(LENGTH_M, NODES), strings, path, time_s[::2])
    assert status[0] == 0
    return CubicSpline(time_s[::2], points[0] @ TO_PLANE.T)


def string_nodes(time_s: np.ndarray, sway_m: float = 0.04) -> np.ndarray:
    """Nodes (F, N, 3) [m] of a string that is swung along x and swayed towards the cameras by `sway_m`."""
    coarse = _simulated(sway_m)(time_s)
    return CubicSpline(np.arange(NODES + 1), coarse, axis=1)(np.linspace(0, NODES, 8 * NODES + 1))


def pixels(camera: Camera, points_m: np.ndarray) -> np.ndarray:
    """The pixels (..., 2) of points (..., 3)."""
    in_camera = points_m @ np.array(camera.rotation).T + np.array(camera.translation_m)
    return distort(camera.lens, in_camera[..., :2] / in_camera[..., 2:])


def even_points(nodes: np.ndarray, count: int = POINTS) -> np.ndarray:
    """Points (F, count+1, k) at equal distances along curves (F, N, k)."""
    out = np.empty((len(nodes), count + 1, nodes.shape[-1]))
    for f, curve in enumerate(nodes):
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
        wanted = np.linspace(0.0, along[-1], count + 1)
        out[f] = np.column_stack([np.interp(wanted, along, axis) for axis in curve.T])
    return out


def seen_by(camera: Camera, nodes_m: np.ndarray, noise_px: float, seed: int) -> np.ndarray:
    """Pixels (F, n+1, 2) as a tracker gives them: points at equal distances along the apparent string."""
    apparent_m = pixel_to_metre(camera, pixels(camera, nodes_m), camera.string_offset_m)
    even_m = even_points(apparent_m)
    flat = np.concatenate([even_m, np.full_like(even_m[..., :1], camera.string_offset_m)], axis=-1)
    exact = pixels(camera, flat)
    return exact + np.random.default_rng(seed).normal(0.0, noise_px, exact.shape)


def clock(
    camera: str = "main", offset_s: float = 0.0, drift: float = 0.0, sigma_s: float = 5e-5
) -> Alignment:
    """The alignment of a camera's clock, known to `sigma_s`."""
    return Alignment(
        experiment="swung",
        trial=1,
        source="fit",
        offset_s=offset_s,
        offset_se_s=sigma_s,
        drift=drift,
        drift_se=1e-6,
        drift_prior=None,
        residual_rms_m=1e-4,
        frames=100,
        motion_start_s=0.0,
        motion_end_s=SECONDS,
        middle_se_s=sigma_s,
        middle_camera_time_s=0.5,
        camera=camera,
    )


def string_view(
    camera: Camera,
    true_clock: Alignment,
    *,
    rate_hz: float = 250.0,
    noise_px: float = 0.2,
    sway_m: float = 0.04,
    seed: int = 0,
    name: str = "left",
) -> StringView:
    """What a camera with a clock of its own saw of the swung string."""
    robot_s = np.arange(0.002, SECONDS - 0.002, 1.0 / rate_hz)
    points_px = seen_by(camera, string_nodes(robot_s, sway_m), noise_px, seed)
    shape = points_px.shape[:2]
    pixels = StringPixels(
        np.arange(len(robot_s)),
        (robot_s - true_clock.offset_s) / (1.0 + true_clock.drift),
        points_px,
        np.broadcast_to(noise_px**2 * np.eye(2), (*shape, 2, 2)),
        np.full(shape, np.nan),
        np.zeros(shape, np.int32),
    )
    return StringView(name, pixels, camera, true_clock)
