"""Meshes: generated with gmsh or read from its files, with their edges and checks of their
quality."""
