from .drawings import read_dxf as read_dxf
from .panels import Gores as Gores
from .panels import gores as gores
