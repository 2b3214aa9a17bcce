"""Motions: Bezier velocity curves, what makes a throw good, and the planners."""
