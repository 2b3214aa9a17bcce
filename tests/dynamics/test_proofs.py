"""Each proof of the string, for each precision that it has a tolerance for."""

import pytest
from proofs import PROOFS, VARIANTS

# Against integrators of small steps, or as another one of them.
LONG = ("dop853", "dop853_in_space", "order_in_space", "strong_damping_in_space", "mujoco_balls_limit")
CASES = [
    pytest.param(*(name, variant), marks=pytest.mark.thorough if variant != "lfcn" or name in LONG else ())
    for name, proof in PROOFS.items()
    for variant in proof.tolerance
]


@pytest.mark.parametrize(("name", "variant"), CASES)
def test_holds(name, variant):
    proof = PROOFS[name]
    error = proof.error(VARIANTS[variant])
    assert error <= proof.tolerance[variant], f"{error:.3g} {proof.unit}"


def test_each_proof_is_of_double_precision():
    assert all("lfcn" in proof.tolerance for proof in PROOFS.values())
