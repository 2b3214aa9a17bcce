"""Integration schemes by name."""
