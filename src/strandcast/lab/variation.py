"""Throw-to-throw variation: clamp, sway, joints and clocks."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from strandcast.config.lab import TYPICAL, LabSettings
from strandcast.seeds import rng

CLOCK_DRIFT = 2e-5  # standard deviation; chosen
HEAVY_TAILS = 4  # degrees of freedom of Student's t; chosen: one deviation in 50 is beyond 2.7 of its sd
DRAWN_FACTORS = (0.3, 3.0)  # of the typical sizes, logarithmic; chosen to be wider than the planner's prior


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


class LabScatter(NamedTuple):
    """How throws of one motion differ on a rig: standard deviations by name, and their tails."""

    sizes: Mapping[str, float]
    heavy_tails: bool = False


TYPICAL_RIG = LabScatter(TYPICAL)


def scatter_of(experiment: str, seed: int, lab: LabSettings) -> LabScatter:
    """Return the scatter of an experiment's rig; one that is drawn depends on name and seed alone."""
    if lab.draws == "unknown_rig":
        return drawn_scatter(rng(experiment, seed, 0, "lab-rig"), lab.sizes)
    return LabScatter(lab.sizes, lab.draws == "heavy_tails")


def drawn_scatter(random: np.random.Generator, about: Mapping[str, float] = TYPICAL) -> LabScatter:
    """Return the scatter of a rig that nobody knows: each size of its own, heavy tails every other time."""
    low, high = np.log(DRAWN_FACTORS)
    sizes = {name: sd * float(np.exp(random.uniform(low, high))) for name, sd in about.items()}
    return LabScatter(sizes, bool(random.integers(2)))


def draw_variation(
    rng: np.random.Generator, joints: int, scale: float, scatter: LabScatter = TYPICAL_RIG
) -> ThrowVariation:
    """Draw a throw's deviations; `scale` 0: none, 1: those of `scatter`."""
    single = rng.standard_normal(5) * scale
    zero, gain = rng.standard_normal((2, joints)) * scale
    if scatter.heavy_tails:
        single, zero, gain = (one * _stretch(rng, len(one)) for one in (single, zero, gain))
    sizes = scatter.sizes
    return ThrowVariation(
        grasp_length_m=float(single[0] * sizes["grasp_length_m"]),
        grasp_lateral_m=float(single[1] * sizes["grasp_lateral_m"]),
        grasp_angle_rad=float(single[2] * sizes["grasp_angle_rad"]),
        sway_rad=float(single[3] * sizes["sway_rad"]),
        sway_rad_s=float(single[4] * sizes["sway_rad_s"]),
        joint_zero_rad=zero * sizes["joint_zero_rad"],
        servo_gain=1.0 + gain * sizes["servo_gain"],
        log_noise_rad=scale * sizes["joint_log_rad"],
    )


def _stretch(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return factors that make normal numbers Student's t ones of the same standard deviation."""
    return np.sqrt((HEAVY_TAILS - 2) / rng.chisquare(HEAVY_TAILS, count))


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
