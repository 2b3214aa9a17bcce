"""The door for data measured elsewhere: joint logs in their makers' dialects, motion capture."""
