"""A compiled scene, and the solvers and time steppers that move it."""
