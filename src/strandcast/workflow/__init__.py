"""Python behind the rules in the top-level folder workflow/: targets, code versions, the runner.

The rules are in workflow/, the code that they run is in `strandcast.stages`.
"""
