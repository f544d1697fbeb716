"""Probes: functions of a run that return one number, the same on every rank.

Outputs write probes to CSV files, events wait for their values, and users call them: `probe(run)`.
"""

from gossamer_fx.core.checks.lazy_names import lazy_names

# Public names are loaded when they are first used: a scene pays only for the probes that it has.
__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
