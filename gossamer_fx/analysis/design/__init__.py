"""Optimisation and identification of parameters."""
