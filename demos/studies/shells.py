"""Linear shells: Scordelis-Lo roof, pinched cylinder and pinched hemisphere as curved plates.

Meshes of order 2 are the stress-free shapes.  A quarter of the roof and of the hemisphere and an
eighth of the cylinder are computed, with planes of symmetry.  Loads are a thousandth of the tabled
ones, so that the motion is linear, and results are given for the tabled loads:

    roof        R = 25, L = 50, t = 0.25, 40° to either side; E = 4.32e8, ν = 0; rigid diaphragms at
                the ends; weight 90 per area.  Deflection in the middle of a free edge: 0.3024
    cylinder    R = 300, L = 600, t = 3, E = 3e6, ν = 0.3; rigid diaphragms at the ends; two forces
                of 1 against each other in the middle.  Deflection there: 1.8248e-5
    hemisphere  R = 10, t = 0.04, E = 6.825e7, ν = 0.3; hole of 18°, free edges; four forces of 2 on
                the equator, outwards and inwards in turn.  Deflection there: 0.0924 to 0.0940

Source: R. H. MacNeal & R. L. Harder, Finite Elements Anal. Des. 1 (1985) 3; T. Belytschko et al.,
Comput. Methods Appl. Mech. Eng. 51 (1985) 221.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.engine.study import ROUND_OFF, WITHOUT_UNITS, Measure, Study, search_figures
from gossamer_fx.meshes.sheet import sheet

Points = npt.NDArray[np.float64]

# Loads over the tabled ones: deflections are a twentieth of the thickness or less.
FACTORS = {"roof": 3e-3, "cylinder": 1e3, "hemisphere": 3e-2}
# Deflections under the tabled loads; of the hemisphere the middle of the published ones.
TABLED = {"roof": 0.3024, "cylinder": 1.8248e-5, "hemisphere": 0.0932}


Shell = tuple[gx.Plate, list[object], gx.Port]


def roof(comm: MPI.Comm, cells: int) -> Shell:
    """A quarter, from the middle of the crown to a diaphragm and a free edge; z is up."""
    radius = 25.0

    def curved(u: Points, v: Points) -> list[Points]:
        angle = math.radians(40) * v
        return [radius * u, radius * np.sin(angle), radius * np.cos(angle)]

    law = gx.Linear(4.32e8, 0.0, density=90.0 / 0.25, thickness=0.25)
    plate = gx.Plate(_curved_sheet(comm, cells, cells, curved), law)
    supports = [
        _symmetry(plate, "left", 0),
        _symmetry(plate, "bottom", 1),
        gx.Fixed(plate, "right", components=(1, 2)),
    ]
    weight = gx.Gravity(plate, (0.0, 0.0, -FACTORS["roof"]))
    return plate, [*supports, weight], plate.port("top left")


def cylinder(comm: MPI.Comm, cells: int) -> Shell:
    """An eighth, from the middle to a diaphragm; x along the cylinder, a force along z."""
    radius = 300.0

    def curved(u: Points, v: Points) -> list[Points]:
        angle = math.pi / 2 * v
        return [radius * u, radius * np.sin(angle), radius * np.cos(angle)]

    law = gx.Linear(3e6, 0.3, density=1.0, thickness=3.0)
    plate = gx.Plate(_curved_sheet(comm, cells, cells, curved), law)
    supports = [
        _symmetry(plate, "left", 0),
        _symmetry(plate, "bottom", 1),
        _symmetry(plate, "top", 2),
        gx.Fixed(plate, "right", components=(1, 2)),
    ]
    tip = plate.port("bottom left")
    # A quarter of the force acts on the eighth.
    force = gx.loads.Force(tip, (0.0, 0.0, -FACTORS["cylinder"] / 4))
    return plate, [*supports, force], tip


def hemisphere(comm: MPI.Comm, cells: int) -> Shell:
    """A quarter, from the hole to the equator; forces outwards along x and inwards along y."""
    radius = 10.0

    def curved(u: Points, v: Points) -> list[Points]:
        longitude = math.pi / 2 * u
        latitude = math.radians(72) * v
        distance = radius * np.cos(latitude)
        return [
            distance * np.cos(longitude),
            distance * np.sin(longitude),
            radius * np.sin(latitude),
        ]

    law = gx.Linear(6.825e7, 0.3, density=1.0, thickness=0.04)
    plate = gx.Plate(_curved_sheet(comm, cells, cells, curved), law)
    outer = plate.port("bottom left")
    # Half of each force acts on the quarter.
    force = FACTORS["hemisphere"]
    items = [
        _symmetry(plate, "left", 1),
        _symmetry(plate, "right", 0),
        gx.Fixed(plate, "top left", components=(2,)),
        gx.loads.Force(outer, (force, 0.0, 0.0), name="outwards"),
        gx.loads.Force(plate.port("bottom right"), (0.0, -force, 0.0), name="inwards"),
    ]
    return plate, items, outer


def _curved_sheet(
    comm: MPI.Comm, nx: int, ny: int, curved: Callable[[Points, Points], list[Points]]
) -> gx.Mesh:
    """Curved triangles of the unit square, of which `curved` gives the points."""
    mesh = sheet(comm, nx, ny, crossed=True, order=2)
    nodes = mesh.domain.geometry.x
    nodes[:] = np.stack(curved(nodes[:, 0], nodes[:, 1]), axis=-1)
    return mesh


def _symmetry(plate: gx.Plate, edge: str, component: int) -> gx.Fixed:
    """A plane of symmetry with its normal along an axis, across which the slope stays."""
    return gx.Fixed(plate, edge, components=(component,), rotation=True)


def problem(comm: MPI.Comm, shell: str, cells: int) -> dict[str, float]:
    """`cells` along an edge."""
    plate, items, port = SHELLS[shell](comm, cells)
    equilibrium = gx.Equilibrium(gx.Scene(plate, *items))
    start = equilibrium.system.unknowns.state.vector(port).copy()
    found = equilibrium.find()
    moved = equilibrium.system.unknowns.state.vector(port) - start
    deflection = float(np.abs(moved).max()) / FACTORS[shell]
    return {
        "deflection": deflection,
        "deflection/tabled": deflection / TABLED[shell],
        **search_figures(found),
        "compile_seconds": equilibrium.compile_seconds,
    }


SHELLS = {"roof": roof, "cylinder": cylinder, "hemisphere": hemisphere}

STUDY = Study(
    "shells",
    "Linear shells: roof, pinched cylinder and hemisphere",
    problem,
    {"shell": list(SHELLS), "cells": [4, 8, 16, 32]},
    lambda case: 1 / case["cells"],
    # Under a point force the cylinder converges slowly.
    (Measure("deflection/tabled", 1.0, 0.01, quick_tolerance=0.1),),
    finer=[{"shell": "cylinder", "cells": 64}],
    quick={"cells": [8]},
    columns="deflection, iterations, seconds",
    expected_warnings=WITHOUT_UNITS | ROUND_OFF,
)
