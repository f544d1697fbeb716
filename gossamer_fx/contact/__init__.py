"""Contact of films, cables, beams and solids: pairs, search, motion check, and the scene's item."""

from gossamer_fx.checks.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
