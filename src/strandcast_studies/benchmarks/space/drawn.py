"""Drawn strings, arms, servos and targets in space; none was used for tuning."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.arm.load import SpatialArm, load_arm
from strandcast.lab.strings import PhysicalString
from strandcast_studies.benchmarks.loop.drawn import (
    BENDING_LENGTH_M,
    CURL_RAD_M,
    EDGE_M,
    FIRST_PLACE_M,
    MATERIAL_KG_M3,
    OF_LENGTH,
    SERVOS,
    THICKEST_M,
    WEIGHT_KG,
    WEIGHTS,
    WIDE_DENSITY_KG_M,
    drawn_weights,
    log_uniform,
)

ARMS = Path(__file__).parents[4] / "config" / "arms"
# How far the hand of each arm gets from the place of its second joint, stretched out [m].
REACH_M = {"ur5e-space": 0.984, "fr3-space": 0.874}
LENGTH_M = (0.25, 0.50)
assert LENGTH_M[0] > FIRST_PLACE_M


@dataclass(frozen=True, eq=False)
class SpaceCase:
    """An arm, its servo, a string with the direction of its curl about itself, and a target (3,) [m]."""

    arm: SpatialArm
    servo: str
    string: PhysicalString
    curl_turn_rad: float
    target_m: np.ndarray

    @property
    def weight_places_m(self) -> list[float]:
        """Places of the weights, from the hand: with the length, all that the planner knows of a string."""
        return [place_m for place_m, _ in self.string.weights]

    def whole_length_m(self) -> float:
        """Return the string's length with what the clamp covers [m]."""
        return self.string.length_m + self.arm.clamp.clamped_length_m


def drawn_case(seed: int) -> SpaceCase:
    """Return the case of a seed: even ones have a UR5e of six joints, odd ones a Franka of seven."""
    random = np.random.default_rng([seed, 7])
    name = ("ur5e-space", "fr3-space")[seed % 2]
    arm = load_arm(ARMS / f"{name}.toml").spatial()
    length_m = round(float(random.uniform(*LENGTH_M)), 2)
    density = log_uniform(WIDE_DENSITY_KG_M, random)
    diameter_m = math.sqrt(4.0 * density / (math.pi * log_uniform(MATERIAL_KG_M3, random)))
    weights = drawn_weights(length_m, random, WEIGHTS, WEIGHT_KG)
    string = PhysicalString(
        length_m,
        density,
        9.81 * density * log_uniform(BENDING_LENGTH_M, random) ** 3,
        float(random.uniform(0.0, CURL_RAD_M)),
        min(diameter_m, THICKEST_M),
        tuple((weight["place_m"], weight["mass_kg"]) for weight in weights),
    )
    turn, servo = float(random.uniform(0.0, 2.0 * np.pi)), SERVOS[random.integers(len(SERVOS))]
    return SpaceCase(arm, servo, string, turn, _target(arm, REACH_M[name], length_m, random))


def _target(arm: SpatialArm, reach_m: float, length_m: float, random: np.random.Generator) -> np.ndarray:
    """Return a place in the workspace that the string can reach but not the hand, in any direction."""
    shoulder_m, box = arm.chain.anchors_m[1], arm.box_m
    while True:
        away_m = random.uniform(-1.0, 1.0, 3) * (reach_m + OF_LENGTH * length_m)
        inside = (shoulder_m + away_m >= box[:, 0] + EDGE_M) & (shoulder_m + away_m <= box[:, 1] - EDGE_M)
        if inside.all() and reach_m < np.linalg.norm(away_m) < reach_m + OF_LENGTH * length_m:
            return np.asarray(np.round(shoulder_m + away_m, 3))
