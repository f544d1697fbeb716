"""The two films of `contact_scene.py`, with contact that conserves."""

from __future__ import annotations

import numpy as np
from contact_scene import DENSITY, DISTANCE, NU, THICKNESS, E, grid, penetrations, thrown
from contestants import words
from mpi4py import MPI
from stopwatch import Stopwatch, show

import gossamer_fx as gx
from gossamer_fx.mechanics.contact.geometry.facets import facets_of
from gossamer_fx.meshes.arrays import mesh_of_arrays
from gossamer_fx.solve.system.totals import relative_drift

case = words({"n": 10, "dt": 1e-4, "until": 0.01, "law": "barrier"})
watch = Stopwatch()
X, triangles = grid(case["n"])


def square() -> gx.Mesh:
    return mesh_of_arrays(MPI.COMM_WORLD, lambda: (X, triangles, {}))


law = gx.Linear(
    E=E,
    nu=NU,
    density=DENSITY,
    thickness=THICKNESS,
)
lower = gx.Membrane(square(), law, name="lower")
upper = gx.Membrane(
    square(),
    law,
    displacement=lambda X: (thrown(X.T)[0] - X.T).T,
    velocity=lambda X: thrown(X.T)[1].T,
    name="upper",
)
contact = gx.Contact(
    lower,
    upper,
    distance=DISTANCE,
    law=case["law"],
)
run = gx.Simulation(gx.Scene(contact), gx.Midpoint(dt=case["dt"]))
figures = watch.measure(run, case["until"])
# Both films as one set of triangles, whose edges are tested against each other.
films = [facets_of(film) for film in (lower, upper)]
places = []
for film, facets in zip((lower, upper), films, strict=True):
    owned = run.system.state[film].part
    places.append(run.system.q0.array_r[owned].reshape(-1, 3)[facets.nodes])
x = np.vstack(places)
show(
    {
        **{
            key: figures[key]
            for key in ("cpu", "wall", "dofs", "steps", "Newton/step", "rejected", "ΔE/E")
        },
        "ΔP/P": relative_drift(run.totals.momentum, run.first.momentum),
        "ΔL/L": relative_drift(run.totals.angular_momentum, run.first.angular_momentum),
        "penetrations": penetrations(
            x, np.vstack([films[0].triangles, films[1].triangles + len(places[0])])
        ),
    }
)
