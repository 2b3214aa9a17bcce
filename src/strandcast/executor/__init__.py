"""The executor: it plays one motion on one arm through a driver, and leaves the joint log."""
