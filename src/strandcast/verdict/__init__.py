"""By how much a throw missed what it was for, from the track."""
