from .air_drag import AirDrag as AirDrag
from .body_forces import Centrifugal as Centrifugal
from .edge_load import EdgeLoad as EdgeLoad
from .edge_load import EdgeMoment as EdgeMoment
from .force import Force as Force
from .force import Torque as Torque
