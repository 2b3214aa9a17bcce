"""strandcast: a robot arm throws a string it has never met, until the string's tip hits."""

__version__ = "0.1.0"
