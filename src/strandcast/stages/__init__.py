"""The stages: each reads files, calls the rooms, writes files.

A rule in the top-level folder workflow/ or a command calls one of them.
"""

import os

# Stages with a command of their own; the others run as `strandcast stage NAME`.
CALLED_BY_NAME = ("track", "estimate", "plan", "report")

# Kernels of another processor give other last digits. OpenBLAS chooses them when numpy is loaded: so before.
# A variable of our own chooses others for the jobs of an experiment, too (`make test-widths`).
os.environ.pop("OPENBLAS_CORETYPE", None)
if "STRANDCAST_OPENBLAS_CORETYPE" in os.environ:
    os.environ["OPENBLAS_CORETYPE"] = os.environ["STRANDCAST_OPENBLAS_CORETYPE"]
