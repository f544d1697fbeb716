from .elastica import Elastica as Elastica
from .film import Linear as Linear
from .film import Miyazaki as Miyazaki
from .film import TensionField as TensionField
