"""Boards and markers to a lens and a plane; pixel to metre and back."""
