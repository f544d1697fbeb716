"""The geometry of rings, in C."""
