from .panels import Gores as Gores
from .panels import gores as gores
