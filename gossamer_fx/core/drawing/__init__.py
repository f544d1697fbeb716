"""Solids that pictures and recordings show: surfaces that move as a whole."""
