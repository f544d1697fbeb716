"""Connectors: springs, ropes, tapes, torsion springs, creases and attached masses."""
