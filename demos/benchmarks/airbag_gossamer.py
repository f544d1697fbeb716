"""Quarter of one sheet of the square airbag at rest, by static equilibrium; see `demos/studies/airbag.py`."""

from __future__ import annotations

import json
import time

from contestants import words
from mpi4py import MPI

from demos.studies.airbag import LAWS, airbag, displacement

case = words({"n": 8})
film, search = airbag(MPI.COMM_WORLD, LAWS["Miyazaki 1e-6"], 1, case["n"])
cpu = time.process_time()
wall = time.perf_counter()
found = search.find()
result = {
    "cpu": time.process_time() - cpu,
    "wall": time.perf_counter() - wall,
    "dofs": search.system.numbering.size,
    "steps": found.iterations,
    "w_M": float(displacement(film, search, "bottom left")[2]),
}
print(json.dumps(result))
