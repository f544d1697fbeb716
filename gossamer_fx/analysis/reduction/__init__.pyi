from .outside_basis import OutsideBasis as OutsideBasis
from .reduced_membrane import reduce as reduce
from .snapshots import Snapshots as Snapshots
