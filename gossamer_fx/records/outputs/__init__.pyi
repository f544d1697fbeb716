from .ledger import Ledger as Ledger
from .probe_table import Probes as Probes
from .progress import Progress as Progress
from .recording import Recording as Recording
from .series import Series as Series
from .static_records import record as record
from .static_records import record_modes as record_modes
from .vtu import VTU as VTU
