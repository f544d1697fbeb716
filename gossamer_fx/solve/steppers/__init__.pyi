from .midpoint import EndPoint as EndPoint
from .midpoint import PathAverage as PathAverage
from .variational import VariationalMidpoint as VariationalMidpoint
