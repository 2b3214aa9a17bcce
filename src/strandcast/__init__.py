"""strandcast: a robot arm throws a string it has never met, until the string's tip hits."""

from strandcast.kernels import use_own_cache

__version__ = "0.1.0"

use_own_cache()
