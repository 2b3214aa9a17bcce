"""The files between the stages: their schemas, atomic writing, verified reading."""
