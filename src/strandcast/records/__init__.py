"""The files between the stages: schemas, atomic writing, verified reading, migrations, provenance."""
