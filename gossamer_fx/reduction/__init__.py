"""Reduced models: a film whose shape is a combination of a few modes."""
