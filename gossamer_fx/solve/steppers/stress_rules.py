"""Stress rules of a step, where users of steppers look for them."""

from gossamer_fx.mechanics.terms.discrete_gradient import EndPoint as EndPoint
from gossamer_fx.mechanics.terms.discrete_gradient import PathAverage as PathAverage
