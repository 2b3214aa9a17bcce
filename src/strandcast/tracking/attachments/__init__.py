"""Weights and stiff sections detected on the string."""
