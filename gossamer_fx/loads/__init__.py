"""Loads, whose work is booked as supplied, and damping, whose loss is booked as dissipated."""
