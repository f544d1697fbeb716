"""Meshes: made with gmsh, read, and judged."""
