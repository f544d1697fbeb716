"""Many runs of one model: values in orthogonal arrays, processes that share the runs, signal-to-noise ratios."""

from gossamer_fx.checks.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
