"""Flight: orbits, gravity of the Earth, Sun and Moon, and the loads of space.  Loaded by scenes
that fly only."""

from gossamer_fx.core.checks.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
