"""Thin plates against closed forms, published tables and one-dimensional solutions.

    elastica       cantilever under a dead end force PL²/EI = 10 (Bisshopp & Drucker 1945), t/L from
                   1e-2 to 1e-5
    Sze (a)        the cantilever of Sze, Liu & Lo (Finite Elem. Anal. Des. 40 (2004) 1551,
                   doi:10.1016/j.finel.2003.11.001), table of 20 loads: worst error of both
                   displacements
    roll-up        their cantilever under an end moment, to a full circle; exact
    slit ring      their slit annular plate, table of 11 loads, error at the last.  (The table is
                   computed too, and ends at W_B 17.528; an isogeometric Kirchhoff-Love shell
                   (PENGoLINS) gives 17.473.)  "free": on a mesh whose edges follow no direction
    curl 1..4      a strip that is at rest curled to 0.5, π/2, π and 0.95·2π; exact
    buckled 1, 2   a pinned strip compressed beyond buckling to end slopes of 60 and 120 degrees:
                   force at the shortening of the extensible elastica with e_E = 1e-4 (Magnusson,
                   Ristinmaa & Ljung 2001)
    pressed 1..3   clamped disc, t/a = 0.01, ν = 0.3, under pressure: w0/t of the meridian's
                   equations
    modes          lowest frequencies of squares and circles, free and clamped, by polynomials of
                   Ritz and Bessel functions; Leissa's values (NASA SP-160, 1969; J. Sound Vib. 31
                   (1973) 257) for comparison

The references are derived again in `tests/unit/test_plate_references.py`.  "error/accepted" is the
worst error of a scene over what is accepted: 0.5 % of the largest displacement; roll-up 0.1 %; curl
0.2 % of the length; buckled and modes 1 %.  Cells that bend by more than 0.15 rad are too stiff.
The two full circles of which 32 cells miss what is accepted are computed with 64 cells, too: the
roll-up on an irregular mesh falls from 0.45 to 0.04 %, and curl 4 from 0.56 to 0.14 %.
"""

from __future__ import annotations

import math
import time
import tomllib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.integrate import cumulative_trapezoid

import gossamer_fx as gx
from demos.common.searches import Effort
from demos.studies.engine.study import (
    ROUND_OFF,
    WITHOUT_UNITS,
    Measure,
    Study,
    search_figures,
)
from gossamer_fx.meshes.plates import free_slit_ring, irregular_sheet, slit_ring
from gossamer_fx.meshes.revolved import whole_disc
from gossamer_fx.meshes.sheet import EDGES, sheet

NU = 0.3
# Reference values, see the file.
DATA = tomllib.loads((Path(__file__).parent / "data" / "plate.toml").read_text(encoding="utf-8"))
# Displacements [m] over the load P/P_max: of the cantilever (-U, W), of the slit ring (W_A, W_B).
SZE_A = {share: (u, w) for share, u, w in DATA["cantilever"]}
SZE_C = {share: (inner, outer) for share, inner, outer in DATA["slit_ring"]}
# Angles [rad] to which strips are curled; the last one is 0.95 of a full circle.
CURLS = (0.5, math.pi / 2, math.pi, 0.95 * 2 * math.pi)
# End slope [deg]: shortening over the length, and P/P_c.
BUCKLED = {slope: (shortening, force) for slope, shortening, force in DATA["buckled"]}
# Load p a⁴/(E t⁴) of a clamped disc: deflection w0/t of its middle.
DISC = dict(DATA["disc"])
# λ² = ω a² √(ρt/D) by nodal diameters and circles.
CIRCLE = {edge: {(m, n): λ2 for m, n, λ2 in rows} for edge, rows in DATA["circle"].items()}
SQUARE = DATA["square"]
LEISSA = DATA["leissa"]

Figures = dict[str, float]

# Long pseudo-steps: these loads are far from an instability.
LONG_STEPS = gx.analysis.Continuation(first_step=50.0)


def isotropic(
    E: float,
    thickness: float,
    nu: float = 0.0,
    density: float = 1000.0,
) -> gx.Linear:
    """A law of plates; without a Poisson effect strips bend as the beams of the closed forms."""
    return gx.Linear(E=E, nu=nu, density=density, thickness=thickness)


# Law of the two cantilevers of Sze, Liu & Lo.
SZE_LAW = isotropic(1.2e6, 0.1, density=1.0)


def positions(equilibrium: gx.Equilibrium, plate: gx.Plate, group: str) -> np.ndarray:
    """Mean position (3,) of the nodes of a group; the same on every rank."""
    x = equilibrium.system.unknowns.q0.array_r.reshape(-1, 3)
    nodes = plate.nodes(group)
    nodes = nodes[nodes < len(x)]
    total = plate.comm.allreduce(np.append(x[nodes].sum(axis=0), len(nodes)))
    return np.asarray(total[:3] / total[3])


def strip(
    comm: MPI.Comm,
    cells: int,
    length: float,
    width: float,
    law: gx.Linear,
    kind: str = "regular",
    **more: object,
) -> tuple[gx.Plate, gx.Fixed]:
    """A plate of length × width [m] with `cells` along it, on a regular or an irregular mesh, and
    its clamped left end."""
    if kind == "irregular":
        # Two rows at least: a single one has no free node to move.
        mesh = irregular_sheet(
            comm,
            cells,
            max(cells // 8, 2),
            length,
            width,
        )
    else:
        mesh = sheet(
            comm,
            cells,
            max(cells // 8, 1),
            length,
            width,
        )
    plate = gx.Plate(mesh, law, **more)
    return plate, gx.Fixed(plate, "left", rotation=True)


def end_error(x: np.ndarray, exact: tuple[float, float], scale: float) -> float:
    """The larger error of x and z of an end x (3,), over a length `scale`."""
    return max(abs(x[0] - exact[0]), abs(x[2] - exact[1])) / scale


def arc(length: float, angle: float) -> tuple[float, float]:
    """x and z of the end of a strip that is an arc of this angle [rad]."""
    return length * math.sin(angle) / angle, length * (1 - math.cos(angle)) / angle


def elastica(comm: MPI.Comm, cells: int, t: float, kind: str = "regular") -> Figures:
    """Cantilever of thickness t [m] under a dead end force; error over the largest displacement."""
    plate, clamp = strip(comm, cells, 1.0, 0.1, isotropic(1e9, t), kind)
    load = gx.loads.EdgeLoad(
        plate,
        "right",
        force=(0.0, 0.0, 10 * 1e9 * t**3 / 12),
    )
    equilibrium = gx.Equilibrium(gx.Scene(plate, clamp, load))
    found = equilibrium.find()
    x = positions(equilibrium, plate, "right")
    error = end_error(x, (1 - 0.554996, 0.810609), 0.810609)
    return {
        "error": error,
        "value": x[2],
        **search_figures(found),
    }


def sze_a(comm: MPI.Comm, cells: int, kind: str = "regular") -> Figures:
    """Cantilever under a dead end force; worst error over the largest displacement."""
    plate, clamp = strip(comm, cells, 10.0, 1.0, SZE_LAW, kind)
    load = gx.loads.EdgeLoad(
        plate,
        "right",
        force=lambda t: (0.0, 0.0, 4 * t),
    )
    equilibrium = gx.Equilibrium(gx.Scene(plate, clamp, load), LONG_STEPS)
    errors = []
    effort = Effort()
    _, largest = SZE_A[1.0]
    for share, (u, w) in SZE_A.items():
        effort.add(equilibrium.find(at=share))
        x = positions(equilibrium, plate, "right")
        errors.append(end_error(x, (10 - u, w), largest))
    return {
        "error": max(errors),
        "value": x[2],
        **vars(effort),
    }


def roll_up(comm: MPI.Comm, cells: int, kind: str = "regular") -> Figures:
    """Cantilever under an end moment, to a full circle; worst error over the length."""
    plate, clamp = strip(comm, cells, 12.0, 1.0, SZE_LAW, kind)
    moment = gx.loads.EdgeMoment(
        plate,
        "right",
        moment=lambda t: 50 * math.pi / 3 * t,
    )
    equilibrium = gx.Equilibrium(gx.Scene(plate, clamp, moment), LONG_STEPS)
    errors = []
    effort = Effort()
    for share in np.linspace(0.125, 1.0, 8):
        effort.add(equilibrium.find(at=share))
        x = positions(equilibrium, plate, "right")
        errors.append(end_error(x, arc(12.0, 2 * math.pi * share), 12.0))
    return {
        "error": max(errors),
        "value": x[0],
        **vars(effort),
    }


def slit(comm: MPI.Comm, cells: int, kind: str = "regular") -> Figures:
    """Slit ring lifted at one end of the slit; relative error of both corners at the last load."""
    if kind == "free":
        mesh = free_slit_ring(comm, 8 / cells, 6.0, 10.0)
    else:
        mesh = slit_ring(
            comm,
            5 * cells // 8,
            5 * cells,
            6.0,
            10.0,
        )
    plate = gx.Plate(mesh, isotropic(21e6, 0.03, density=1.0))
    load = gx.loads.EdgeLoad(
        plate,
        "start",
        force=lambda t: (0.0, 0.0, 0.8 * t),
    )
    clamp = gx.Fixed(plate, "end", rotation=True)
    equilibrium = gx.Equilibrium(gx.Scene(plate, clamp, load), LONG_STEPS)
    effort = Effort()
    # The table is given at all loads; its last row has the largest displacements.
    for share in SZE_C:
        effort.add(equilibrium.find(at=share))
    nodes = plate.nodes("start")
    radius = plate.space.tabulate_dof_coordinates()[nodes, 0]
    z = equilibrium.system.unknowns.q0.array_r.reshape(-1, 3)[:, 2]
    here = nodes < len(z)
    errors = []
    for r, exact in zip((6.0, 10.0), SZE_C[1.0], strict=True):
        corner = nodes[here & (abs(radius - r) < 1e-9)]
        # A rank without this corner is neutral in the maximum.
        height = comm.allreduce(float(z[corner].max(initial=-math.inf)), op=MPI.MAX)
        errors.append(abs(height / exact - 1))
    return {
        "error": max(errors),
        "value": height,
        **vars(effort),
    }


def curl(comm: MPI.Comm, cells: int, angle: float) -> Figures:
    """A strip that is at rest as a part of a circle; error of its end over the length of 1 m."""
    curved = np.diag((angle, 0.0, 0.0))
    plate, clamp = strip(comm, cells, 1.0, 0.1, isotropic(1e9, 1e-3), rest_curvature=curved)
    equilibrium = gx.Equilibrium(gx.Scene(plate, clamp))
    found = equilibrium.find()
    x = positions(equilibrium, plate, "right")
    return {
        "error": end_error(x, arc(1.0, angle), 1.0),
        "value": x[0],
        **search_figures(found),
    }


def buckled(comm: MPI.Comm, cells: int, slope: int, kind: str = "regular") -> Figures:
    """Half of the pinned strip: clamped in its middle, free to turn at its end."""
    half = 0.5
    # (π²/12) (t/L)² of the table: how far the strip is from inextensible.
    e_E = 1e-4
    t = math.sqrt(12 * e_E) / math.pi
    shortening, exact = BUCKLED[slope]
    stations = np.linspace(0, half, 201)
    # Nearly the slope [rad] of the elastica: a start on the buckled branch.
    θ = math.radians(slope) * np.sin(math.pi * stations / (2 * half))
    x = cumulative_trapezoid(np.cos(θ), stations, initial=0)
    z = cumulative_trapezoid(np.sin(θ), stations, initial=0)

    def bent(X: np.ndarray) -> np.ndarray:
        """Displacement (3, n) to that shape."""
        along = np.interp(X[0], stations, x) - X[0]
        return np.stack([along, 0 * X[0], np.interp(X[0], stations, z)])

    plate, _ = strip(
        comm,
        cells,
        half,
        0.05,
        isotropic(1e6, t),
        kind,
        displacement=bent,
    )
    clamp = gx.Fixed(
        plate,
        "left",
        rotation=True,
        direction=(1.0, 0.0, 0.0),
    )
    end = gx.Fixed(
        plate,
        "right",
        motion=lambda X, t: np.array([[-shortening * half], [0], [0]]) + 0 * X,
        components=(0,),
    )
    search = gx.analysis.Continuation(first_step=0.05)
    equilibrium = gx.Equilibrium(gx.Scene(plate, clamp, end), search)
    found = equilibrium.find()
    force, _ = equilibrium.reaction(end)
    critical = 1e6 * t * 0.05 * (1 - math.sqrt(1 - 4 * e_E)) / 2
    value = -force[0] / critical
    return {
        "error": abs(value / exact - 1),
        "value": value,
        **search_figures(found),
    }


def pressed(comm: MPI.Comm, cells: int, load: float) -> Figures:
    """Clamped disc of radius 1 m under the pressure `load` E t⁴/a⁴; relative error of w0."""
    t = 0.01
    plate = gx.Plate(whole_disc(comm, cells), isotropic(1e9, t, NU))
    pressure = gx.Pressure(plate, load * 1e9 * t**4)
    equilibrium = gx.Equilibrium(gx.Scene(plate, gx.Fixed(plate, "rim", rotation=True), pressure))
    found = equilibrium.find()
    own_height = float(equilibrium.system.unknowns.q0.array_r[2::3].max(initial=0.0))
    value = comm.allreduce(own_height, op=MPI.MAX) / t
    return {
        "error": abs(value / DISC[load] - 1),
        "value": value,
        **search_figures(found),
    }


def frequencies(comm: MPI.Comm, cells: int, shape: str, edge: str) -> Figures:
    """The lowest modes, of which the plane ones of so thin a plate are none."""
    law = isotropic(1e9, 1e-3, NU)
    if shape == "circle":
        rims: Sequence[str] = ("rim",)
        mesh = whole_disc(comm, cells)
        # A mode with nodal diameters comes twice, turned by a quarter of its period.
        values = []
        for (diameters, _), λ2 in CIRCLE[edge].items():
            values += [λ2, λ2] if diameters else [λ2]
        exact = np.sort(values)
    else:
        rims = EDGES
        mesh = sheet(comm, cells, cells, crossed=True)
        exact = np.array(SQUARE[edge])
    plate = gx.Plate(mesh, law)
    clamps = []
    if edge == "clamped":
        clamps = [gx.Fixed(plate, rim, rotation=True) for rim in rims]
    # Without a load, round-off decides when the flat plate is at rest.
    equilibrium = gx.Equilibrium(gx.Scene(plate, *clamps), gx.analysis.Continuation(tolerance=1e-4))
    found = equilibrium.find()
    began = time.process_time()
    # Frequency [Hz] of λ² = 1.
    unit = math.sqrt(law.E * law.thickness**2 / (12 * (1 - NU**2)) / law.density) / (2 * math.pi)
    rigid = 0
    shift = 0.0
    if edge == "free":
        # Six rigid motions of zero frequency; the search begins above them.
        rigid = 6
        shift = 0.3 * exact[0] * unit
    modes = gx.analysis.modes(equilibrium, len(exact) + rigid, above=shift)
    found_modes = np.array([mode.frequency for mode in modes])[rigid:] / unit
    return search_figures(found) | {
        "error": float(abs(found_modes / exact - 1).max()),
        "value": float(found_modes[0]),
        "seconds": found.seconds + time.process_time() - began,
    }


# By the name of a scene: what computes it on a number of cells, and the error that is accepted.
SCENES: dict[str, tuple[Callable[[MPI.Comm, int], Figures], float]] = {}
for thickness in (1e-2, 1e-3, 1e-4, 1e-5):
    SCENES[f"elastica t/L {thickness:.0e}"] = (partial(elastica, t=thickness), 5e-3)
SCENES["elastica irregular"] = (partial(elastica, t=1e-3, kind="irregular"), 5e-3)
SCENES["Sze (a)"] = (sze_a, 5e-3)
SCENES["Sze (a) irregular"] = (partial(sze_a, kind="irregular"), 5e-3)
SCENES["roll-up"] = (roll_up, 1e-3)
SCENES["roll-up irregular"] = (partial(roll_up, kind="irregular"), 1e-3)
SCENES["slit ring"] = (slit, 5e-3)
# The edges of a free mesh follow no line about which the ring bends.
SCENES["slit ring free"] = (partial(slit, kind="free"), 5e-3)
for number, angle in enumerate(CURLS, start=1):
    SCENES[f"curl {number}"] = (partial(curl, angle=angle), 2e-3)
for number, slope in enumerate(BUCKLED, start=1):
    SCENES[f"buckled {number}"] = (partial(buckled, slope=slope), 1e-2)
for number, load in enumerate(DISC, start=1):
    SCENES[f"pressed {number}"] = (partial(pressed, load=load), 5e-3)
for shape in ("square", "circle"):
    for edge in ("free", "clamped"):
        SCENES[f"modes {shape} {edge}"] = (partial(frequencies, shape=shape, edge=edge), 1e-2)


def expected_order(scene: str) -> float:
    """In h.  The table of the ring is half a percent off the limit; pressed plates have boundary
    layers."""
    if scene.startswith("slit"):
        return math.inf
    return 1.5 if scene.startswith(("pressed", "modes")) else 2.0


def problem(comm: MPI.Comm, scene: str, cells: int) -> Figures:
    """Solve one scene; `error/accepted` is its error over what is accepted."""
    solve, accepted = SCENES[scene]
    figures = solve(comm, cells)
    return {"error/accepted": figures["error"] / accepted, **figures}


STUDY = Study(
    "plate",
    "Thin plates",
    problem,
    {"scene": list(SCENES), "cells": [8, 16, 32]},
    lambda case: 1 / case["cells"],
    (
        Measure(
            "error/accepted",
            0.0,
            1.0,
            lambda case: expected_order(case["scene"]),
            quick_tolerance=2.5,
            is_quick_asymptotic=False,
        ),
    ),
    finer=[{"scene": scene, "cells": 64} for scene in ("roll-up irregular", "curl 4")],
    quick={"scene": ["elastica t/L 1e-03", "curl 2", "pressed 2"], "cells": [4, 8]},
    expected_warnings={
        **ROUND_OFF,
        **WITHOUT_UNITS,
        "nothing resists translation": "the six rigid motions of free plates are left out",
        "modes are cut from a group": "the references end between two modes of one frequency",
    },
    columns="value, error, iterations, seconds",
)
