"""A string in a film, without a robot: its held end, its scale, its track, and the files of it."""
