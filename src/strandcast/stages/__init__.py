"""The stages: each reads files, calls the rooms, writes files.

A rule in the top-level folder workflow/ or a command calls one of them.
"""
