"""Trials and fitted strings in the formats of other programs."""
