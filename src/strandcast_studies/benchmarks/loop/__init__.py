"""The whole loop of throwing, fitting and planning on many strings and seeds."""
