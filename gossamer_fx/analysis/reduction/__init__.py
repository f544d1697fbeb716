"""Reduced models: films whose shape is a combination of a few modes, see `reduction.basis`."""

from gossamer_fx.core.checks.lazy_names import lazy_names

# Public names are loaded when they are first used.
__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
