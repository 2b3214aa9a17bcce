"""Importers of data measured elsewhere: joint logs in their makers' dialects, motion capture."""
