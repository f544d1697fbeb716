"""Numbering of all unknowns, measures of points, exchange between ranks, and the algebra of
angles and rotations."""
