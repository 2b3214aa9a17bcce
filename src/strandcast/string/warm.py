"""Compile the kernels once, so that no throw waits for them: ``python -m strandcast.string.warm``."""

from __future__ import annotations

import numpy as np

from strandcast.string.model import StringModel
from strandcast.string.parameters import RANGES
from strandcast.string.simulate import simulate


def compile_kernels() -> None:
    """Run the smallest simulation; numba keeps the machine code beside the sources."""
    time_s = np.array([0.0, 0.002])
    simulate(StringModel(0.1, 2), RANGES["wide"][:, 0], np.ones(2), time_s, np.zeros((2, 3)), time_s)


if __name__ == "__main__":
    compile_kernels()
