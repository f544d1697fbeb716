"""Vibration modes, frequencies and waves."""
