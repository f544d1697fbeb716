from .enclosure import Piston as Piston
from .orifice import WallHeat as WallHeat
from .ring import Ring as Ring
from .volumes import Ambient as Ambient
