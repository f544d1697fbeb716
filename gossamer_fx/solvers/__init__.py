"""Newton's iteration and its linear solvers."""
