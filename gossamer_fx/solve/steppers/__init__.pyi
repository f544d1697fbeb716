from .generalized_alpha import GeneralizedAlpha as GeneralizedAlpha
from .midpoint import EndPoint as EndPoint
from .midpoint import Midpoint as Midpoint
from .midpoint import PathAverage as PathAverage
from .step_control import StepControl as StepControl
from .variational import VariationalMidpoint as VariationalMidpoint
