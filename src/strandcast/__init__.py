"""strandcast: a robot arm throws a string it has never met, until the string's tip hits."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from strandcast.kernel_cache import use_own_cache

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

    from strandcast.api import FilmTrack, Project
    from strandcast.records.record import Record

__all__ = ["__version__", "load", "open", "simulate", "track_film"]
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


def simulate(time_s: np.ndarray, place_m: np.ndarray, **string: Any) -> np.ndarray:
    """Return the path of a string with one or two moving ends; see docs/how-to/simulate-a-string.md.

    The arguments are those of `strandcast.dynamics.physical.simulate`.
    """
    from strandcast.api import simulate as simulate_string  # heavy too

    return simulate_string(time_s, place_m, **string)


def track_film(video: str | Path, **known: Any) -> FilmTrack:
    """Return the track of a string in a film, without an experiment; see docs/how-to/track-a-film.md.

    What may be known of it are the fields of `strandcast.film.known.FilmKnown`.
    """
    from strandcast.api import track_film as track  # heavy too

    return track(video, **known)
