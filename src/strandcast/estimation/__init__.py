"""Evaluation value, searches and the estimate of a string from its measured throws."""
