"""Candidate pairs: bounds of trajectories, a tree of boxes, and the list of pairs that may come
near."""
