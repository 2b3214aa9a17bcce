"""Observations in pixels and camera records to the track in metres."""
