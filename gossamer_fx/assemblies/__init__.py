"""Assemblies: what takes several parts, in one call."""
