"""Solids that are drawn and recorded: surfaces that move as a whole."""
