"""The stages: each reads files, calls the rooms, writes files.

A rule in the top-level folder workflow/ or a command calls one of them.
"""

import os

# Kernels of another processor give other last digits. OpenBLAS chooses them when numpy is loaded: so before.
os.environ.pop("OPENBLAS_CORETYPE", None)
