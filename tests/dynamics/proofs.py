"""All proofs of the string; ``python tests/dynamics/proofs.py lfcn gauge mirror`` prints errors as JSON."""

import json
import sys

import numpy as np
import proofs_ball_joints
import proofs_dynamics
import proofs_references
import proofs_space
import proofs_statics
import proofs_symmetries
from proof import PROOFS, VARIANTS, Proof

import strandcast

MODULES = (
    proofs_statics,
    proofs_dynamics,
    proofs_symmetries,
    proofs_references,
    proofs_space,
    proofs_ball_joints,
)

__all__ = ["MODULES", "PROOFS", "VARIANTS", "Proof", "errors"]


def errors(variant: str, names: list[str]) -> dict[str, float]:
    """Error of each of the named proofs, NaN where a proof could not be evaluated."""
    found = {}
    for name in names:
        try:
            found[name] = float(PROOFS[name].error(VARIANTS[variant]))
        except (AssertionError, ValueError, np.linalg.LinAlgError):
            found[name] = float("nan")
    return found


if __name__ == "__main__":
    of_variant = sys.argv[1]
    wanted = sys.argv[2:] or [name for name, proof in PROOFS.items() if of_variant in proof.tolerance]
    print(json.dumps({"package": strandcast.__file__, "errors": errors(of_variant, wanted)}))
