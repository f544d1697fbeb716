from .orthotropic import AroundAxis as AroundAxis
from .thermal import ThermalExpansion as ThermalExpansion
