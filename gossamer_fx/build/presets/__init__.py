"""Figures of real films, fibres, composites and gases, each with its source; surfaces are in
`orbit.optics`."""

from gossamer_fx.core.checks.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
