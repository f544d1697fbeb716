"""The square airbag at rest: laws and residual stiffnesses side by side.

Two flat square sheets of diagonal 1.2 m, 0.6 mm thick, E = 588 MPa, ν = 0.4, joined along the
edges, which stay in z = 0; overpressure 5 kPa.  M is the centre, A a corner.  Volume V and total
potential converge: they are judged.  w_M and u_A scatter with the mesh and have no order; w_M by
some 0.1 % in both orders.  There are several equilibria: on 32 cells some laws find one of which
w_M is 0.4 % higher, and the potential 0.015 % lower.
For the problem and results of others see Jarasjarungkiat, Wüchner & Bletzinger, CMAME 198 (2009)
1097.
"""

from __future__ import annotations

import math

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.engine.study import NOT_STABLE, Measure, Study, search_figures
from gossamer_fx.extend import AreaFractions, FieldFunctions, FilmLaw
from gossamer_fx.meshes.sheet import crossed_sheet

# Overpressure [Pa].
PRESSURE = 5000.0
# Half of the edge of a square whose diagonal is 1.2 m.
HALF_EDGE = 0.6 / math.sqrt(2)
FILM = {"E": 588e6, "nu": 0.4, "density": 1000.0, "thickness": 6e-4}
LAWS: dict[str, FilmLaw] = {
    "Miyazaki 1e-6": gx.Miyazaki(**FILM, residual_stiffness=1e-6),
    "Miyazaki 1e-8": gx.Miyazaki(**FILM, residual_stiffness=1e-8),
    "Elastica 0.4 m": gx.Elastica(**FILM, half_wavelength=0.4),
    "TensionField": gx.TensionField(**FILM),
}
# A quarter of one sheet is computed; volumes are those of the whole.
SHEETS = 2
QUARTERS = 4


def airbag(
    comm: MPI.Comm, law: FilmLaw, order: int, cells: int
) -> tuple[gx.Membrane, gx.Equilibrium]:
    """A quarter of one sheet with `cells` along half an edge, each of four triangles, in its planes
    of symmetry."""
    film = gx.Membrane(
        crossed_sheet(comm, cells, cells, HALF_EDGE, HALF_EDGE),
        law,
        order=order,
    )
    # The seam stays in its plane.
    seam = [gx.Fixed(film, edge, components=(2,)) for edge in ("top", "right")]
    symmetry = [
        gx.Fixed(film, "bottom", components=(1,)),
        gx.Fixed(film, "left", components=(0,)),
    ]
    return film, gx.Equilibrium(gx.Scene(film, gx.Pressure(film, PRESSURE), *seam, *symmetry))


def displacement(film: gx.Membrane, search: gx.Equilibrium, point: str) -> np.ndarray:
    """Of a named point [m]."""
    port = film.port(point)
    return search.system.unknowns.state.vector(port) - port.initial()


def volume_and_potential(found: gx.analysis.EquilibriumResult) -> tuple[float, float]:
    """Volume [m³] and total potential [J] of the whole airbag at rest: strain energy less the work
    of the pressure, which is p V."""
    parts = SHEETS * QUARTERS
    work = parts * found.totals.supplied
    return work / PRESSURE, parts * sum(found.totals.stored.values()) - work


def print_equilibria(
    law: str = "Miyazaki 1e-8", cells: int = 32, starts: int = 6, perturbation: float = 0.02
) -> None:
    """Print the equilibria of airbags of order 1 that are found from several starts.

    Command: ./gossamer python -c "from demos.studies import airbag; airbag.print_equilibria()"
    """
    film, search = airbag(MPI.COMM_WORLD, LAWS[law], 1, cells)
    found = gx.analysis.equilibria(search, starts=starts, perturbation=perturbation)
    for one in found:
        one.take(search)
        volume, potential = volume_and_potential(one.result)
        height = displacement(film, search, "bottom left")[2]
        if MPI.COMM_WORLD.rank == 0:
            print(
                f"starts {one.starts}: height {height:.5f} m, volume {volume:.5f} m³, "
                f"potential {potential:.2f} J, unstable {one.result.unstable}"
            )


def stress_at(film: gx.Membrane, search: gx.Equilibrium, point: str) -> float:
    """Larger principal stress [Pa], mean of the cells at a named point."""
    fields = FieldFunctions(search.system, film, ["second_piola_stress1"])
    fields.update()
    [σ1] = fields.functions
    cells = film.space.dofmap.list[: film.mesh.domain.topology.index_map(2).size_local]
    here, _ = np.nonzero(np.isin(cells, film.nodes(point)))
    # The middles of the edges if there are any: their mean.
    values = σ1.x.array[σ1.function_space.dofmap.list[here, -3:]]
    total, n = film.comm.allreduce(np.array([values.sum(), values.size]))
    return float(total / n)


def problem(
    comm: MPI.Comm,
    law: str,
    element: str,
    cells: int,
) -> dict[str, float]:
    """`cells` along half an edge of order 1, half as many of order 2: as many unknowns."""
    order = {"P1": 1, "P2": 2}[element]
    film, search = airbag(comm, LAWS[law], order, cells // order)
    found = search.find()
    slack, wrinkled, _ = AreaFractions([film])(search.system)
    volume, potential = volume_and_potential(found)
    return {
        "w_M": float(displacement(film, search, "bottom left")[2]),
        "u_A": float(np.linalg.norm(displacement(film, search, "top right"))),
        "V": volume,
        "potential": potential,
        "σ1_M": stress_at(film, search, "bottom left"),
        "wrinkled": wrinkled,
        "slack": slack,
        **search_figures(found),
        "compile_seconds": search.compile_seconds,
    }


STUDY = Study(
    "airbag",
    "Square airbag at rest",
    problem,
    {"law": list(LAWS), "element": ["P1", "P2"], "cells": [8, 16, 32]},
    lambda case: HALF_EDGE / case["cells"],
    (
        Measure("w_M", 0.2164, 5e-3),
        Measure("u_A", 0.0494, 2e-2),
        Measure("V", 0.1250, 5e-3, lambda case: 2.0),
        # J; by order 1 with 64 cells, and by order 2 with 16, within 1e-4.
        Measure("potential", -622.0, 5e-3, lambda case: 2.0),
        Measure("σ1_M", 3.92e6, 4e-2),
    ),
    quick={"law": ["Miyazaki 1e-6", "Elastica 0.4 m"], "cells": [4, 8]},
    columns="wrinkled, slack, iterations, residual, seconds",
    expected_warnings=NOT_STABLE,
)
