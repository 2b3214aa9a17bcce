"""Evidence on real, measured motion: what the string model predicts of series that it was not fitted to."""
