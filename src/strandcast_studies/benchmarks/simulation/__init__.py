"""The string's simulation compared with other simulators."""
