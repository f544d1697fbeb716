"""A compiled scene: unknowns, equations, matrices, and the energy balance."""
