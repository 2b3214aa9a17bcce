"""Random generators determined by the experiment's name, its seed, the trial and the stage."""

import hashlib

import numpy as np


def seed_of(experiment: str, seed: int, trial: int, stage: str) -> int:
    """Return a 63-bit seed; the same arguments give the same seed on every computer."""
    words = f"{experiment}\0{seed}\0{trial}\0{stage}".encode()
    return int.from_bytes(hashlib.sha256(words).digest()[:8], "big") >> 1


def rng(experiment: str, seed: int, trial: int, stage: str) -> np.random.Generator:
    """Return the random generator of one stage of one trial."""
    return np.random.default_rng(seed_of(experiment, seed, trial, stage))
