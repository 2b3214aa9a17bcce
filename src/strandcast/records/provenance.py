"""Provenance of result files: the versions of strandcast and of the libraries that made them."""

import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from strandcast import __version__

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
def _versions() -> tuple[tuple[str, str], ...]:
    found = [("strandcast", __version__), ("python", ".".join(map(str, sys.version_info[:3])))]
    for name in LIBRARIES:
        try:
            found.append((name, version(name)))
        except PackageNotFoundError:  # the computer at the arm needs only some of them
            continue
    return tuple(found)


def current_versions() -> dict[str, str]:
    """Return the versions of strandcast, Python and the installed libraries of `LIBRARIES`, by name."""
    return dict(_versions())
