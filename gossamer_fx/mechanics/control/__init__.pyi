from .attitude import AttitudeControl as AttitudeControl
from .attitude import patch as patch
