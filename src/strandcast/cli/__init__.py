"""The command line."""

import os
from importlib import import_module

# Results must not depend on the number of cores or on settings of the shell: before numpy is imported.
for _name in [name for name in os.environ if name.startswith(("OPENBLAS_", "MKL_", "BLIS_", "OMP_"))]:
    del os.environ[_name]
os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
import_module("strandcast.stages")  # chooses the kernels of OpenBLAS
