"""Coulomb friction of contact pairs."""
