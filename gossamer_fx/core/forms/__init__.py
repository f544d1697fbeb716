"""Strain measures and bending forms in UFL, their compilation, and the interface to dolfinx."""
