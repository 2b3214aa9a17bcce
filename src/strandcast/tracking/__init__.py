"""Frames to mass points: the hand's markers, the string beyond the clamp, and how sure we are of both."""
