"""Provenance of result files: the versions of strandcast and of the libraries that made them."""

import sys
from functools import cache

from strandcast import __version__
from strandcast.packages import installed_version

# The libraries on which numbers in results depend. A fixed list, not the imported modules: a stage writes the
# same bytes however it is run.
LIBRARIES = (
    "av",
    "mujoco-core",
    "numba",
    "numpy",
    "opencv-contrib-python-headless",
    "pyarrow",
    "scikit-image",
    "scipy",
)


@cache
def _versions() -> dict[str, str]:
    python = ".".join(map(str, sys.version_info[:3]))
    found = {name: installed_version(name) for name in LIBRARIES}  # at the arm only some of them
    return {"strandcast": __version__, "python": python} | {k: v for k, v in found.items() if v is not None}


def current_versions() -> dict[str, str]:
    """Return the versions of strandcast, Python and the installed libraries of `LIBRARIES`, by name."""
    return dict(_versions())
