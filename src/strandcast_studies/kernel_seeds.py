"""Write the seeds of compiled kernels that `make wheel` puts into the wheel (see `strandcast.kernel_seed`).

python -m strandcast_studies.kernel_seeds build/kernels
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from strandcast.kernel_cache import kernels_sha256
from strandcast.kernel_seed import MANIFEST, cpu_levels, made_from, seed_name, sha256

DEMO = """
import subprocess, sys
line = [sys.executable, "-m", "strandcast"]
subprocess.run([*line, "new", "lab"], check=True)
subprocess.run([*line, "run", "demo"], cwd="lab", check=True)
"""


def write_seed(out: Path, level: str, program: str = DEMO) -> Path:
    """Run a program that compiles kernels for a level of processors; return the folder of the seed."""
    seed = (out / seed_name(level)).resolve()
    shutil.rmtree(seed, ignore_errors=True)
    settings = {"NUMBA_CACHE_DIR": str(seed), "NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": ""}
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-c", program], cwd=folder, env=os.environ | settings, check=True)
    found = sorted(path for path in seed.rglob("*") if path.is_file())
    files = {path.relative_to(seed).as_posix(): sha256(path.read_bytes()) for path in found}
    manifest = {"made_from": made_from(kernels_sha256()), "files": files}
    (seed / MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n")
    return seed


if __name__ == "__main__":
    for level in cpu_levels():
        print(write_seed(Path(sys.argv[1]), level))
