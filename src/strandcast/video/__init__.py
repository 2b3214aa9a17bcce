"""Files to frames: which video this is, whether it is whole, and its frames in order."""
