from .enclosure import Piston as Piston
from .mixture import Mixture as Mixture
from .orifice import WallHeat as WallHeat
from .polynomial_gas import PolynomialGas as PolynomialGas
from .ring import Ring as Ring
from .valve import Valve as Valve
from .volumes import Ambient as Ambient
