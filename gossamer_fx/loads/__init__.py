"""Loads, whose work is booked as supplied, and damping, whose loss is booked as dissipated."""

from gossamer_fx.checks.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
