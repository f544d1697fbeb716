"""Exact derivatives of results with respect to parameters, by adjoint equations.

The entry point is `gx.analysis.gradient`.
"""
