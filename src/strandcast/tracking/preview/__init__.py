"""What the tracker sees in a few frames, before tracking."""
