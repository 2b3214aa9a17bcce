"""By how much a throw missed its objective, from the track."""
