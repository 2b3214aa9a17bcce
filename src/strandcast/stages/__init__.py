"""The stages: each reads files, calls the rooms, writes files.

A rule in the top-level folder workflow/ or a command calls one of them.
"""

import os

# Another processor's kernels give other last digits. OpenBLAS chooses them when numpy is loaded, so before that.
os.environ.pop("OPENBLAS_CORETYPE", None)
