"""PyElastica's Cosserat rod with position Verlet; all strings in one simulator, for its memory blocks."""

from typing import Any

import elastica
import numpy as np
from elastica.boundary_conditions import ConstraintBase
from numba import njit

from strandcast.dynamics.parameters import Array
from strandcast_studies.benchmarks.simulation.swing import (
    DURATION_S,
    GRAVITY_M_S2,
    LENGTH_M,
    SEGMENTS,
    HandSwing,
    every,
    stretched_m,
)

# Affects rotational inertia only. A cord is thinner, but its shear waves would need a smaller step.
_RADIUS_M = 0.005
# PyElastica has no dampers between elements; without damping, waves persist and no step converges.
_DAMPING_1_S = 2.0
_STATE = ("position_collection", "velocity_collection", "director_collection", "omega_collection")


class _Simulator(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing, elastica.Damping):
    pass


@njit(cache=True)
def _place(position: Array, x: float, y: float) -> None:
    position[0, 0], position[1, 0], position[2, 0] = x, y, 0.0


class _Hand(ConstraintBase):
    """Holds the first node at the hand; the rod can turn freely there."""

    def __init__(self, path: Array, rate: Array, half_s: float, **settings: Any) -> None:
        super().__init__(**settings)
        self.path, self.rate, self.half_s = path, rate, half_s

    def constrain_values(self, system: Any, time: float) -> None:
        x, y = self.path[int(time / self.half_s + 0.5)]
        _place(system.position_collection, x, y)

    def constrain_rates(self, system: Any, time: float) -> None:
        x, y = self.rate[int(time / self.half_s + 0.5)]
        _place(system.velocity_collection, x, y)


class CosseratRod:
    """The peer."""

    def __init__(self, swing: HandSwing, parameters: Array, dt_s: float, threads: int = 1) -> None:
        self.dt_s, self.each = dt_s, every(dt_s)
        self.steps = round(DURATION_S / dt_s)
        pose, rate = swing.at(np.linspace(0.0, DURATION_S, 2 * self.steps + 1))
        self.path = [(float(x), float(y)) for x, y in pose[:, :2]]
        self.rate = [(float(x), float(y)) for x, y in rate[:, :2]]
        self.simulator, self.rods = self._simulator(parameters)
        self.start = [[getattr(rod, name).copy() for name in _STATE] for rod in self.rods]

    def _simulator(self, parameters: Array) -> tuple[Any, list[Any]]:
        simulator, rods = _Simulator(), []
        for row in parameters:
            rod = _rod(row, self.path[0])
            simulator.append(rod)
            simulator.add_forcing_to(rod).using(
                elastica.GravityForces, acc_gravity=np.array([0.0, -GRAVITY_M_S2, 0.0])
            )
            simulator.constrain(rod).using(_Hand, path=self.path, rate=self.rate, half_s=0.5 * self.dt_s)
            simulator.dampen(rod).using(
                elastica.AnalyticalLinearDamper, uniform_damping_constant=_DAMPING_1_S, time_step=self.dt_s
            )
            rods.append(rod)
        simulator.finalize()
        return simulator, rods

    def positions(self) -> Array:
        """Simulate; return positions (B, F, n+1, 2) [m] at the common times."""
        for rod, state in zip(self.rods, self.start, strict=True):
            for name, values in zip(_STATE, state, strict=True):
                getattr(rod, name)[...] = values
        stepper = elastica.PositionVerlet()
        frames = self.steps // self.each
        out = np.empty((len(self.rods), frames, SEGMENTS + 1, 2))
        time = np.float64(0.0)
        for frame in range(frames):
            for _ in range(self.each):
                time = stepper.step(self.simulator, time, np.float64(self.dt_s))
            for rod, kept in zip(self.rods, out, strict=True):
                kept[frame] = rod.position_collection[:2].T
        return out


def _rod(parameters: Array, hand: tuple[float, float]) -> Any:
    """Return a rod of 1 kg per segment that hangs from the hand, with the string's stiffnesses."""
    spacing = LENGTH_M / SEGMENTS
    area = np.pi * _RADIUS_M**2
    rod = elastica.CosseratRod.straight_rod(
        SEGMENTS,
        np.array([*hand, 0.0]),
        np.array([0.0, -1.0, 0.0]),
        np.array([0.0, 0.0, 1.0]),
        LENGTH_M,
        _RADIUS_M,
        SEGMENTS / (LENGTH_M * area),
        youngs_modulus=parameters[0] * spacing / area,
    )
    for axis in range(2):
        rod.bend_matrix[axis, axis] = parameters[2] * spacing
    rod.position_collection[1, 1:] = hand[1] - np.cumsum(stretched_m(parameters[0]))
    return rod
