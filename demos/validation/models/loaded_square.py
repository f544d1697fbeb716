"""A square of film on rollers along two edges, under equal forces on all nodes of the two others,
or under a prestress that is released.

The film stays plane: x is held on the edge x = 0, y on y = 0.  Nodes of the edges are where the
source has them, since the forces act on them; the mesh between them is a grid, which differs from
the source's.  The displacement of the corner depends on the mesh, as one triangle fills the corner
and bears all of its force.
"""

from __future__ import annotations

import time

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.extend import check
from gossamer_fx.meshes.arrays import (
    cell_corners,
    mesh_of_arrays,
    plane_grid,
    polyline,
    triangles_of,
)

# Numbers that a case may leave out, with the unit in which they are set then.
OPTIONAL_INPUTS = {"node_force": "N", "parts": "1", "prestress": "Pa"}

DENSITY = 1000.0  # [kg/m³]; it only paces the search for the equilibrium


def square_mesh(comm: MPI.Intracomm, x: Array, y: Array) -> gx.Mesh:
    """The grid of the coordinates x (n,) and y (m,) [m], with one triangle in the corner that is
    pulled.  Groups: "left", "bottom"."""

    def arrays() -> tuple[Array, Array, dict[str, Array]]:
        grid = np.arange(len(x) * len(y)).reshape(len(y), len(x))
        cell = cell_corners(grid)
        lower = triangles_of(cell.a, cell.b, cell.d)
        upper = triangles_of(cell.b, cell.c, cell.d)
        triangles = np.vstack([lower, upper])
        groups = {
            "left": polyline(grid[:, 0]),
            "bottom": polyline(grid[0]),
        }
        return plane_grid(x, y), triangles, groups

    return mesh_of_arrays(comm, arrays)


def nodes_of(inputs: Inputs, name: str) -> Array:
    """Coordinates of the nodes of an edge [m], rising from 0."""
    nodes = inputs.numbers(name, "m")
    check(
        len(nodes) > 1 and nodes[0] == 0 and bool((np.diff(nodes) > 0).all()),
        f"{inputs.where}: {name} does not rise from 0; give the coordinates of the nodes.",
    )
    return nodes


def refined(nodes: Array, parts: int) -> Array:
    """Coordinates with each interval divided into equal parts."""
    count = parts * (len(nodes) - 1) + 1
    return np.interp(np.linspace(0, len(nodes) - 1, count), np.arange(len(nodes)), nodes)


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Displacement ux, uy [m] of the pulled corner; the quick form is the same."""
    begun = time.process_time()
    x = nodes_of(inputs, "nodes_x")
    y = nodes_of(inputs, "nodes_y")
    parts = inputs.whole("parts") if "parts" in inputs else 1
    direction = inputs.numbers("direction", "1")
    check(len(direction) == 3, f"{inputs.where}: direction has not three numbers.")
    law = gx.LinearOrthotropic(
        inputs.number("E1", "Pa", above=0),
        inputs.number("E2", "Pa", above=0),
        inputs.number("poisson", "1"),
        inputs.number("G12", "Pa", above=0),
        thickness=inputs.number("thickness", "m", above=0),
        density=DENSITY,
        direction=tuple(direction),
    )
    stress = None
    if "prestress" in inputs:
        axis = direction / np.linalg.norm(direction)
        stress = inputs.number("prestress", "Pa", above=0) * np.outer(axis, axis)
    film = gx.Membrane(
        square_mesh(comm, refined(x, parts), refined(y, parts)),
        law,
        initial_stress=stress,
    )
    force = inputs.number("node_force", "N") if "node_force" in inputs else 0.0
    pulled = (float(x[-1]), float(y[-1]), 0.0)
    loads = []
    if force:
        for node in y.tolist():
            port = film.port_at((pulled[0], node, 0.0))
            name = f"right {node}"
            loads.append(gx.loads.Force(port, (force, 0.0, 0.0), name=name))
        for node in x.tolist():
            port = film.port_at((node, pulled[1], 0.0))
            name = f"top {node}"
            loads.append(gx.loads.Force(port, (0.0, force, 0.0), name=name))
    scene = gx.Scene(
        film,
        gx.Fixed(film, "left", components=(0,)),
        gx.Fixed(film, "bottom", components=(1,)),
        gx.Fixed(film, "film", components=(2,)),
        *loads,
    )
    search = gx.Equilibrium(scene)
    search.find()
    corner = film.port_at(pulled)
    moved = search.system.unknowns.state.vector(corner) - corner.initial()
    quantities = {"ux": Predicted(float(moved[0])), "uy": Predicted(float(moved[1]))}
    details = {
        "unknowns": float(search.system.unknowns.numbering.size),
        "seconds": time.process_time() - begun,
    }
    return Prediction(quantities, details)
