from .elastica import Elastica as Elastica
from .film import Linear as Linear
from .film import Miyazaki as Miyazaki
from .film import TensionField as TensionField
from .orthotropic import AroundAxis as AroundAxis
from .orthotropic import LinearOrthotropic as LinearOrthotropic
from .orthotropic import Orthotropic as Orthotropic
from .thermal import ThermalExpansion as ThermalExpansion
