"""Flat cut patterns: gores of bodies of revolution, and outlines from drawings."""

from gossamer_fx.core.checks.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
