"""strandcast: a robot arm throws a string it has never met, until the string's tip hits."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from strandcast.kernel_cache import use_own_cache

if TYPE_CHECKING:
    import pandas as pd

    from strandcast.api import Project
    from strandcast.records.record import Record

__all__ = ["__version__", "load", "open"]
__version__ = "0.2.0"

use_own_cache()


def load(path: str | Path) -> Record | pd.DataFrame:
    """Return a result file as a pandas table (.parquet, joints.csv) or as a record (.json).

    See `strandcast.records.load.load`, and docs/reference/reading-results.md.
    """
    from strandcast.records.load import load as load_result  # pandas and pyarrow are heavy: not at start-up

    return load_result(path)


def open(root: str | Path = ".") -> Project:
    """Return a project by its folder, the one that holds data/ and results/; see docs/reference/api.md."""
    from strandcast.api import Project  # heavy too

    return Project(root)
