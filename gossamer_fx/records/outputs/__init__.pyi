from .progress import Progress as Progress
from .recording import Recording as Recording
from .static_records import record as record
from .static_records import record_modes as record_modes
from .tables import Ledger as Ledger
from .tables import Probes as Probes
from .tables import Series as Series
from .vtu import VTU as VTU
