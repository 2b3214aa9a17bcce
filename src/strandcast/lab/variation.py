"""Throw-to-throw variation: clamp, sway, joints and clocks."""

from dataclasses import dataclass

import numpy as np

# Standard deviations of a typical rig (scale 1); chosen.
GRASP_LENGTH_M = 0.002
GRASP_LATERAL_M = 0.001
GRASP_ANGLE_RAD = np.radians(3.0)
SWAY_RAD = 0.010
SWAY_RAD_S = 0.050
JOINT_ZERO_RAD = 0.001
SERVO_GAIN = 0.01
JOINT_LOG_RAD = 0.0005
CLOCK_DRIFT = 2e-5


@dataclass(frozen=True, eq=False)
class ThrowVariation:
    """One throw's deviations: (J,) for the joints, scalars for the rest."""

    grasp_length_m: float
    grasp_lateral_m: float
    grasp_angle_rad: float
    sway_rad: float
    sway_rad_s: float
    joint_zero_rad: np.ndarray
    servo_gain: np.ndarray
    log_noise_rad: float


def draw_variation(rng: np.random.Generator, joints: int, scale: float) -> ThrowVariation:
    """Draw a throw's deviations; `scale` 0: none, 1: those of a typical rig."""
    single = rng.standard_normal(5) * scale
    zero, gain = rng.standard_normal((2, joints)) * scale
    return ThrowVariation(
        grasp_length_m=float(single[0] * GRASP_LENGTH_M),
        grasp_lateral_m=float(single[1] * GRASP_LATERAL_M),
        grasp_angle_rad=float(single[2] * GRASP_ANGLE_RAD),
        sway_rad=float(single[3] * SWAY_RAD),
        sway_rad_s=float(single[4] * SWAY_RAD_S),
        joint_zero_rad=zero * JOINT_ZERO_RAD,
        servo_gain=1.0 + gain * SERVO_GAIN,
        log_noise_rad=scale * JOINT_LOG_RAD,
    )


@dataclass(frozen=True)
class LabClocks:
    """The clocks of one throw: robot time = camera time · (1 + drift) + offset.

    Attributes
    ----------
    log_start_s
        Robot time at which the joint log begins.
    camera_lead_s
        Time from the first frame to the motion's start on the robot's clock [s].
    drift
        Drift of the camera's clock against the robot's.
    """

    log_start_s: float
    camera_lead_s: float
    drift: float


def draw_clocks(rng: np.random.Generator) -> LabClocks:
    """Draw the clocks of one throw, which are unknown to the pipeline."""
    return LabClocks(
        log_start_s=round(float(rng.uniform(1.0, 5.0)), 3),
        camera_lead_s=float(rng.uniform(0.18, 0.30)),
        drift=float(rng.standard_normal() * CLOCK_DRIFT),
    )
