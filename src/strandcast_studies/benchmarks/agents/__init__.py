"""The lab as a benchmark: a Gymnasium environment, agents, and a table of their misses."""

import gymnasium

gymnasium.register("strandcast/Throw-v0", "strandcast_studies.benchmarks.agents.env:ThrowEnv")
