"""The string's speed and error beside its peers: `python -m strandcast.bench.run`."""
