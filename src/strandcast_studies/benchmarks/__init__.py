"""The string's speed and error beside its peers: `python -m strandcast_studies.benchmarks.simulation.run`."""
