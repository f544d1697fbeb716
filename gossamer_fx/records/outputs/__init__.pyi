from .progress import Progress as Progress
from .static_records import record as record
from .static_records import record_modes as record_modes
from .tables import Probes as Probes
from .vtu import VTU as VTU
