"""Bodies: what has coordinates and mass."""
