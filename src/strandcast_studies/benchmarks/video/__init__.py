"""The tracker on filmed throws, compared with peers."""
