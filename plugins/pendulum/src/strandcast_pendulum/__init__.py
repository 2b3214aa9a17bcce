"""A ball on a thread that swings from a fixed pivot."""
