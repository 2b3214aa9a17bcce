"""Camera calibration from boards and markers; mapping between pixels and metres."""
