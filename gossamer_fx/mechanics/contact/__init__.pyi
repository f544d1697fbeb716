from .cone import Cone as Cone
from .obstacles import Box as Box
from .obstacles import Cylinder as Cylinder
from .obstacles import Plane as Plane
from .obstacles import Sphere as Sphere
