"""What a batch of recorded experiments costs besides the stages' own work."""
