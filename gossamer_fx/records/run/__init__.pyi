from ...core.checks.ending import Interrupted as Interrupted
from .checkpoint import latest_checkpoint as latest_checkpoint
from .log import log_to as log_to
