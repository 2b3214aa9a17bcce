"""One figure per file; each says what it found."""
