"""Throws in space: planned, thrown in the lab, fitted and planned again, on drawn strings."""
