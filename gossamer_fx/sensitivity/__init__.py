"""Exact derivatives of results with respect to parameters, by adjoint equations.

The entry points are `gx.analysis.gradient` and `gx.analysis.minimise`.
"""
