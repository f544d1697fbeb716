from ...core.checks.interruption import Interrupted as Interrupted
from .checkpoint import Checkpoints as Checkpoints
from .checkpoint import latest_checkpoint as latest_checkpoint
from .events import At as At
from .events import When as When
from .log import log_to as log_to
from .simulation import Simulation as Simulation
