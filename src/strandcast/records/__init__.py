"""The files between the stages: schemas, atomic writing, verified reading, provenance."""
