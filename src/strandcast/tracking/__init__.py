"""Frames to mass points: the hand's markers, the string beyond the clamp, and the uncertainty of both."""
