"""Equilibria, form finding and stress at rest."""
