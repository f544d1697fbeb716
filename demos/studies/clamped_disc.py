"""A clamped disc under pressure: every law must rise to the same height, since nothing wrinkles.

StVK disc of radius a = 1 m, ν = 0.3, under the follower pressure q = pa/(Et).  In the reference
radius s,

    (s N1)' = N2 cos θ,   s N1 θ' = -N2 sin θ - p r λ1,   r' = λ1 cos θ,   z' = λ1 sin θ

with N_i = t S_i λ_i and λ2 = r/s; the references are the solution of these equations.
"""

from __future__ import annotations

from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.engine.study import Measure, Study, search_figures
from gossamer_fx.extend import FilmLaw
from gossamer_fx.meshes.disc import quarter_disc

# A radius of 1 m; pressures are given over E t/a.
FILM = {"E": 1e9, "nu": 0.3, "density": 1000.0, "thickness": 1e-4}
LAWS: dict[str, FilmLaw] = {
    "Linear": gx.Linear(**FILM),
    "Miyazaki": gx.Miyazaki(**FILM, residual_stiffness=1e-6),
    "Elastica": gx.Elastica(**FILM, half_wavelength=0.05),
}
EXACT = {
    1e-2: (0.141385, 0.020395, 0.233565),
    0.1: (0.309515, 0.101325, 0.527859),
}  # q: w0/a, S(0)/E, V/a³


def problem(comm: MPI.Comm, law: str, element: str, q: float, nodes: int) -> dict[str, float]:
    """A quarter of the disc with `nodes` along a radius."""
    order = {"P1": 1, "P2": 2}[element]
    film = gx.Membrane(
        quarter_disc(comm, nodes // order, 1.0, order),
        LAWS[law],
        order=order,
    )
    supports = [
        gx.Fixed(film, "rim"),
        gx.Fixed(film, "x axis", components=(1,)),
        gx.Fixed(film, "y axis", components=(0,)),
    ]
    p = q * FILM["E"] * FILM["thickness"]
    equilibrium = gx.Equilibrium(gx.Scene(film, gx.Pressure(film, p), *supports))
    found = equilibrium.find()
    heights = equilibrium.system.unknowns.q0.array_r.reshape(-1, 3)[:, 2]
    return {
        "w0/a": comm.allreduce(float(heights.max(initial=0.0)), op=MPI.MAX),
        "V/a³": 4 * found.totals.supplied / p,
        **search_figures(found),
        "compile_seconds": equilibrium.compile_seconds,
    }


STUDY = Study(
    "clamped_disc",
    "Clamped disc under pressure",
    problem,
    {"law": list(LAWS), "element": ["P1", "P2"], "q": [1e-2, 0.1], "nodes": [4, 8, 16, 32]},
    lambda case: 1 / case["nodes"],
    (
        Measure(
            "w0/a",
            lambda case: EXACT[case["q"]][0],
            3e-3,
            lambda case: 2.0 if case["element"] == "P1" else 3.0,
        ),
        Measure("V/a³", lambda case: EXACT[case["q"]][2], 5e-3, lambda case: 2.0),
    ),
    quick={"law": ["Miyazaki"], "q": [0.1], "nodes": [4, 8, 16]},
)
