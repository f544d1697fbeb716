from .generalized_alpha import GeneralizedAlpha as GeneralizedAlpha
from .midpoint import Midpoint as Midpoint
from .step_control import StepControl as StepControl
from .stress_rules import EndPoint as EndPoint
from .stress_rules import PathAverage as PathAverage
from .variational import VariationalMidpoint as VariationalMidpoint
