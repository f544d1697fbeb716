"""Equilibria, form finding and vibration modes."""
