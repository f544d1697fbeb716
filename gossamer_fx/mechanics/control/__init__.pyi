from .attitude import AttitudeControl as AttitudeControl
from .attitude import patch as patch
from .feedback import BodyTorque as BodyTorque
from .feedback import Feedback as Feedback
from .feedback import ReactionWheel as ReactionWheel
from .feedback import Thruster as Thruster
