"""The streaming loop, and its safety monitor."""
