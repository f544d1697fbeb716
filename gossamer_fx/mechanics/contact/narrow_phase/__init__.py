"""Exact geometry of candidate pairs: closest points, collisions during a step, intersections."""
