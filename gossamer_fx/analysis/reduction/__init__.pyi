from .basis import Snapshots as Snapshots
from .outside_basis import OutsideBasis as OutsideBasis
from .reduced_membrane import reduce as reduce
