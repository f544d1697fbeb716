from .scene import RigidMotion as RigidMotion
from .scene import Scene as Scene
from .scene import StartFrom as StartFrom
