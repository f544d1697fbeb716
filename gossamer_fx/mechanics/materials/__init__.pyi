from .fabric import Fabric as Fabric
from .orthotropic import AroundAxis as AroundAxis
from .rubber import MooneyRivlin as MooneyRivlin
from .rubber import NeoHooke as NeoHooke
from .thermal import ThermalExpansion as ThermalExpansion
