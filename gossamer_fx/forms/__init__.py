"""UFL: its compilation, and the small vocabulary in which measures are written."""
