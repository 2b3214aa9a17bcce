"""Benchmarks, evidence on real data, the paper's reproduction: not part of an installation."""
