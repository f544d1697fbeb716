from .outside_basis import OutsideBasis as OutsideBasis
from .recorded_shapes import RecordedShapes as RecordedShapes
from .recorded_shapes import Snapshots as Snapshots
from .reduced_membrane import reduce as reduce
