"""Drivers of arms: the protocol, the registry, and the ones that ship."""
