"""Video files: format, completeness, time stamps, and grey frames in order."""
