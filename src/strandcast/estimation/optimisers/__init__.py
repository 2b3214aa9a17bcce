"""Searches for the string that explains the throws, each registered under its name."""
