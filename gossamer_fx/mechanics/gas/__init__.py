"""Gas: well mixed chambers, connected by openings and coupled to films by pressure and volume."""

from gossamer_fx.core.checks.lazy_names import lazy_names

# Public names are loaded when they are first used: a scene without gas does not import this
# package.
__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
