from .arms import Ikaros as Ikaros
from .parallelograms import Miura as Miura
from .parallelograms import Star as Star
from .polyline import Roll as Roll
from .polyline import Zigzag as Zigzag
from .stow import Stow as Stow
from .tube_zigzag import TubeZigzag as TubeZigzag
