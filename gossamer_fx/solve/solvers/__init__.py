"""Newton's method for the equations of a step, and its linear solvers."""
