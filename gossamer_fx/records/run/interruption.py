"""The public name of the exception that ends an interrupted run."""

from gossamer_fx.core.checks.interruption import Interrupted as Interrupted
