"""Quarter of one sheet of the square airbag at rest, by static equilibrium; see
`demos/studies/airbag.py`."""

from __future__ import annotations

import json
import math
import time

from airbag_fabric import MODULI
from contestants import words
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.airbag import FILM, LAWS, airbag, displacement

case = words({"n": 8, "order": 1, "law": "isotropic", "angle": 0.0})
law = LAWS["Miyazaki 1e-6"]
if case["law"] == "fabric":
    angle = math.radians(case["angle"])
    # The direction of the fabric's first moduli, in the plane of the film.
    law = gx.Orthotropic(
        **MODULI,
        density=FILM["density"],
        thickness=FILM["thickness"],
        direction=(math.cos(angle), math.sin(angle), 0.0),
        residual_stiffness=1e-6,
    )
film, search = airbag(MPI.COMM_WORLD, law, case["order"], case["n"])
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
