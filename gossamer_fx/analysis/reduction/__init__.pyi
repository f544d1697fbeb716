from .model_reduction import reduce as reduce
from .outside_basis import OutsideBasis as OutsideBasis
from .recorded_shapes import RecordedShapes as RecordedShapes
from .snapshots import Snapshots as Snapshots
