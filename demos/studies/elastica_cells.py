"""Why a film with the law `Elastica` that may leave its plane has no equilibrium on fine meshes.

The film is that of `elastica_law` with 200 µm, whose wrinkles have the half wavelength λ = 31.8 mm.
The law gives the film the compressive stress s = D (π/λ)²/t across the wrinkles, but no bending
stiffness.  A wave w = a sin(kx) of the film then has the energy per area

    -s t k² a²/4,

which is negative for every k: the plane film is unstable against waves of any length, the more so
the shorter they are, and the shortest are those of the mesh.  The number of unstable directions
grows like that of the cells.  This is not a limit load: the discrete problem has no limit for fine
meshes.

With its bending stiffness (a `Plate` with the same law) the wave has

    (D k⁴ - s t k²) a²/4 = D k² (k² - (π/λ)²) a²/4:

only waves longer than λ are unstable, whose number does not depend on the mesh.

Each case finds the equilibrium of the exactly plane film, counts the negative eigenvalues of its
tangent for displacements across the plane ("unstable"), and searches again from waves of 1 µm.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from scipy import sparse

import gossamer_fx as gx
from demos.studies.elastica_law import FILM, HEIGHT, LENGTH, half_wavelength, moved, sheared, waved
from demos.studies.engine.study import NOT_REGULAR, NOT_STABLE, Claim, Study
from gossamer_fx.meshes.sheet import sheet

THICKNESS = 200e-6  # m
BODIES = ("film", "plate")
TOLERANCE = 1e-4  # of the unbalanced force, as in `elastica_law`
# The films that come to rest take at most 211 iterations.
ITERATIONS = 400
# Eigenvalues that are smaller than the largest one by this factor count as zero.
ROUND_OFF = 1e-9


def search_from(
    comm: MPI.Comm, body: str, columns: int, is_plane: bool
) -> tuple[gx.Fixed, gx.Equilibrium]:
    """The sheared film or plate with square cells, `columns` along it, from a plane or a wavy
    start."""
    law = gx.Elastica(**FILM, thickness=THICKNESS, half_wavelength=half_wavelength(THICKNESS))
    mesh = sheet(comm, columns, round(columns * HEIGHT / LENGTH), LENGTH, HEIGHT)
    start = sheared if is_plane else waved
    film: gx.Membrane
    if body == "plate":
        film = gx.Plate(mesh, law, displacement=start)
    else:
        film = gx.Membrane(mesh, law, order=2, displacement=start)
    above = gx.Fixed(film, "top", motion=moved)
    scene = gx.Scene(film, gx.Fixed(film, "bottom"), above)
    search = gx.analysis.Continuation(tolerance=TOLERANCE, total_iterations=ITERATIONS)
    return above, gx.Equilibrium(scene, search)


def unstable_directions(equilibrium: gx.Equilibrium) -> int:
    """Number of negative eigenvalues of the tangent for displacements across the plane.

    The film is plane, so that these do not couple with displacements in the plane.  On one rank.
    """
    system = equilibrium.system
    system.equations.set_inertia(0.0)
    tangent = system.matrices.tangent()
    size = tangent.getSize()[0]
    z = np.arange(2, size, 3)
    starts, columns, values = tangent.getValuesCSR()
    across = sparse.csr_array((values, columns, starts))[z][:, z].toarray()
    eigenvalues = np.linalg.eigvalsh((across + across.T) / 2)
    return int((eigenvalues < -ROUND_OFF * np.abs(eigenvalues).max()).sum())


def problem(comm: MPI.Comm, body: str, columns: int) -> dict[str, float]:
    """The plane equilibrium, its unstable directions, and the search that may leave the plane."""
    # The matrix is taken apart as a whole; every rank solves the small problem by itself.
    above, plane = search_from(MPI.COMM_SELF, body, columns, is_plane=True)
    found = plane.find()
    _, free = search_from(MPI.COMM_SELF, body, columns, is_plane=False)
    values = {
        "cell [mm]": 1e3 * LENGTH / columns,
        "force": float(plane.reaction(above)[0][0]),
        "energy": sum(found.totals.stored.values()),
        "unstable": unstable_directions(plane),
        "plane iterations": found.iterations,
        "iterations": float(ITERATIONS),
        "seconds": found.seconds,
        "at rest": 0.0,
    }
    try:
        result = free.find()
        values["iterations"] = result.iterations
        values["seconds"] += result.seconds
        values["at rest"] = 1.0
    except gx.NoEquilibrium:
        # No equilibrium is a result of this study.
        pass
    heights = free.system.unknowns.q0.array_r[2::3]
    values["free energy"] = sum(free.system.balance.totals().stored.values())
    values["height [mm]"] = 1e3 * float(np.abs(heights).max())
    return values


STUDY = Study(
    "elastica_cells",
    "A sheared film with Elastica: unstable directions and mesh",
    problem,
    {"body": list(BODIES), "columns": [12, 16, 24, 36]},
    lambda case: LENGTH / case["columns"],
    quick={"columns": [12, 24]},
    shows=("at rest", "force", "height [mm]"),
    expected_warnings=NOT_REGULAR | NOT_STABLE,
    claims=(
        # Of docs/theory/wrinkling.md: the finer the cells, the more unstable directions has the
        # film; a plate comes to rest, with the force of the film that is kept in its plane.
        Claim("unstable", 10, 10, {"body": "film", "columns": 12}),
        Claim("unstable", 90, 112, {"body": "film", "columns": 36}),
        Claim("at rest", 1, 1, {"body": "plate"}),
        Claim("force", 131.0, 131.4, {"columns": 12}),
        Claim("force", 129.7, 130.1, {"columns": 24}),
        Claim("force", 129.4, 129.8, {"columns": 36}),
    ),
    columns=(
        "cell [mm], unstable, at rest, iterations, force, energy, free energy, height [mm], "
        "plane iterations, seconds"
    ),
)
