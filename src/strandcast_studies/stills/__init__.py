"""The string in a single picture: its ordered centreline, through self-crossings."""
