"""Strain measures and bending forms in UFL, compilation of forms and of C functions, and the
interface to dolfinx."""
