"""Fields of a state on the meshes of bodies: positions, strains, stresses, wrinkling states."""

from gossamer_fx.core.checks.lazy_names import lazy_names

# Public names are loaded when they are first used.
__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
