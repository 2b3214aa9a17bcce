"""The string in space: the plane's forces in three dimensions, held by one clamp or by two."""
