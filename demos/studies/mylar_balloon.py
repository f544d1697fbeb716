"""The mylar balloon: two discs of an inextensible film, wrinkled everywhere (G. I. Taylor 1919).

For discs of radius a (Paulsen, Amer. Math. Monthly 101 (1994) 953), with R the inflated radius,

    a/R = ∫₀¹ dt/√(1-t⁴),   thickness = 2 R ∫₀¹ t² dt/√(1-t⁴),   V = (2/3) π a R².

An elastic film of pa/(Et) = q tends to it for q → 0; two values of q are extrapolated.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.engine.study import NOT_STABLE, Measure, Study
from gossamer_fx.extend import FilmLaw
from gossamer_fx.meshes.disc import quarter_disc

FILM = {"E": 1e9, "nu": 0.3, "density": 1000.0, "thickness": 1e-4}
LAWS: dict[str, FilmLaw] = {
    "Miyazaki 1e-6": gx.Miyazaki(**FILM, residual_stiffness=1e-6),
    "TensionField": gx.TensionField(**FILM),
}
# Pressure over E t/a: so small that the film hardly stretches.
Q = 1e-3
# A quarter of the upper half is computed.
HALVES = 2
QUARTERS = 4
# Cells along a radius; finer meshes of order 2 wrinkle in many ways at this pressure.
CELLS = {
    "P1": (6, 12, 24),
    "P2": (4, 8, 12),
}


def inflate(
    comm: MPI.Comm, law: FilmLaw, order: int, cells: int, q: float
) -> tuple[np.ndarray, gx.analysis.EquilibriumResult]:
    """(R/a, thickness/a, V/a³) of a quarter of the upper half, from flat."""
    film = gx.Membrane(
        quarter_disc(comm, cells, 1.0, order),
        law,
        order=order,
    )
    held = [
        gx.Fixed(film, "rim", components=(2,)),
        gx.Fixed(film, "x axis", components=(1,)),
        gx.Fixed(film, "y axis", components=(0,)),
    ]
    p = q * FILM["E"] * FILM["thickness"]
    search = gx.Equilibrium(gx.Scene(film, gx.Pressure(film, p), *held))
    found = search.find()
    x = search.system.unknowns.q0.array_r.reshape(-1, 3)
    rim = [node for node in film.nodes("rim") if node < len(x)]
    radii, n = comm.allreduce(np.array([np.hypot(x[rim, 0], x[rim, 1]).sum(), len(rim)]))
    height = comm.allreduce(float(x[:, 2].max(initial=0.0)), op=MPI.MAX)
    return np.array(
        [radii / n, HALVES * height, HALVES * QUARTERS * found.totals.supplied / p]
    ), found


def problem(comm: MPI.Comm, law: str, element: str, level: int) -> dict[str, float]:
    """Shape of the balloon at zero strain, extrapolated from two pressures."""
    order = {"P1": 1, "P2": 2}[element]
    cells = CELLS[element][level]
    (coarse, first), (fine, second) = (
        inflate(
            comm,
            LAWS[law],
            order,
            cells,
            q,
        )
        for q in (2 * Q, Q)
    )
    # The error is linear in the pressure: extrapolate to zero.
    radius, thickness, volume = 2 * fine - coarse
    return {
        "R/a": radius,
        "thickness/a": thickness,
        "V/a³": volume,
        "iterations": first.iterations + second.iterations,
        "residual": max(first.residual, second.residual),
        "seconds": first.seconds + second.seconds,
    }


STUDY = Study(
    "mylar_balloon",
    "Mylar balloon",
    problem,
    {"law": list(LAWS), "element": ["P1", "P2"], "level": [0, 1, 2]},
    lambda case: 1 / CELLS[case["element"]][case["level"]],
    (
        Measure("R/a", 0.762759764, 5e-3),
        Measure("thickness/a", 0.913893162, 5e-3),
        Measure("V/a³", 1.218524216, 5e-3, quick_tolerance=0.05),
    ),
    quick={"law": ["Miyazaki 1e-6"], "level": [0]},
    expected_warnings=NOT_STABLE,
)
