"""The string as a chain of links, fitted to every frame."""
