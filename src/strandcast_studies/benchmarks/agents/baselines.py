"""Agents to compare with: random search, and CMA-ES that trains on the string it is scored on."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from gymnasium import spaces

from strandcast_studies.benchmarks.agents.cma_es import cma_es
from strandcast_studies.benchmarks.agents.env import REFUSED_M, Observation

# Chosen, not tuned. CMA-ES begins at the best of a share of random throws.
RANDOM_SHARE, SIGMA, POPULATION = 1 / 3, 0.1, 8


class Agent(Protocol):
    """What throws: it sees observations alone."""

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next action."""


class RandomSearch:
    """Random actions that the arm plays; after `training` throws, always the nearest of them.

    Parameters
    ----------
    space, preflight
        The actions, and whether the arm plays one.
    random
        Source of randomness.
    training
        Throws before those that are scored, at the same string; 0: every throw is a new one.
    """

    def __init__(
        self,
        space: spaces.Box,
        preflight: Callable[[np.ndarray], bool],
        random: np.random.Generator,
        training: int,
    ) -> None:
        self.space, self.preflight, self.random, self.training = space, preflight, random, training
        self.best, self.least_m = np.zeros(space.shape), np.inf

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next action."""
        thrown, miss_m = int(observation["throw"][0]), float(np.linalg.norm(observation["closest_m"]))
        if 0 < thrown <= self.training:
            self.learn(observation["action"], miss_m)
        if self.training and thrown >= self.training:
            return self.best
        return self.next_action(thrown)

    def learn(self, action: np.ndarray, miss_m: float) -> None:
        """Take note of the last throw's measured miss."""
        if miss_m < self.least_m:
            self.best, self.least_m = action, miss_m

    def next_action(self, thrown: int) -> np.ndarray:
        """Return an action to learn from."""
        while True:
            action = np.asarray(self.random.uniform(-1.0, 1.0, self.space.shape), np.float32)
            if self.preflight(action):
                return action


class Cma(RandomSearch):
    """CMA-ES (the library `cma`) over actions; see `RandomSearch` for the parameters."""

    def __init__(
        self,
        space: spaces.Box,
        preflight: Callable[[np.ndarray], bool],
        random: np.random.Generator,
        training: int,
    ) -> None:
        super().__init__(space, preflight, random, training)
        self.at_random = round(RANDOM_SHARE * training)
        self.candidates: list[np.ndarray] = []
        self.values_m: list[float] = []

    def learn(self, action: np.ndarray, miss_m: float) -> None:
        """Take note of the last throw's measured miss."""
        super().learn(action, miss_m)
        if self.candidates:
            self.values_m.append(miss_m)

    def next_action(self, thrown: int) -> np.ndarray:
        """Return the next candidate that the arm plays; others count as a miss of a metre."""
        if thrown < self.at_random or not self.training:
            return super().next_action(thrown)
        if thrown == self.at_random:
            self.strategy = cma_es(self.best.ravel(), SIGMA, POPULATION, self.random, tolfun=1e-6)
            self.candidates = self.strategy.ask()
        while True:
            if len(self.values_m) == len(self.candidates):
                self.strategy.tell(self.candidates, self.values_m)
                self.candidates, self.values_m = self.strategy.ask(), []
            candidate = self.candidates[len(self.values_m)].reshape(self.space.shape)
            if self.preflight(candidate):
                return np.asarray(np.clip(candidate, -1.0, 1.0), np.float32)
            self.values_m.append(REFUSED_M)
