from .ledger import Ledger as Ledger
from .progress import Progress as Progress
from .recording import Recording as Recording
from .series import Series as Series
from .vtu import VTU as VTU
from .vtx import VTX as VTX
from .vtx import Probes as Probes
