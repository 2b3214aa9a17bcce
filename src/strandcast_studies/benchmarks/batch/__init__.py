"""The overhead of a batch of recorded experiments over the stages' own work."""
