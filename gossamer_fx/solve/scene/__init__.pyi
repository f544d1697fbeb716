from .initial import RigidMotion as RigidMotion
from .initial import StartFrom as StartFrom
from .scene import Scene as Scene
