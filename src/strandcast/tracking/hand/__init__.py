"""The hand's pose from the markers it carries."""
