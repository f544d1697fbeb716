"""Meshes with an imperfection in the shape of a mode, for paths."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from dolfinx import fem

from gossamer_fx.analysis.sensitivity.variables import MeshNodes
from gossamer_fx.analysis.vibration.natural_modes import Mode
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.forms.backend import geometry_element, with_points
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import WITH_NODES
from gossamer_fx.mechanics.bodies.beam import Beam
from gossamer_fx.mechanics.bodies.cable import Cable
from gossamer_fx.mechanics.bodies.membrane import Membrane


@check_arguments
def imperfect_mesh(
    body: Annotated[Membrane | Cable | Beam, WITH_NODES], mode: Mode, *, amplitude: float
) -> Mesh:
    """The mesh of a body, displaced by a mode: a stress-free shape with a fault.  Collective.

    A perfect column or shell goes straight on through its buckling load; a real one has an
    imperfection, and bends from the start.  Make the scene from the perfect mesh, find an
    equilibrium and its modes, and make the scene again from this mesh, for `path`.  A mode of
    vibration just below the buckling load has the shape in which the scene buckles.

    The mesh has the cells and groups of the other one, which stays as it is.  Nodes of its order
    are displaced: a curved line of a mesh of order 1 becomes a polygon.

    Args:
        body: a film, plate, cable or beam that is not reduced.
        mode: from `modes`; of a complex one the real part counts.
        amplitude: the component of displacement of a node of the body that is largest [m]; a
            negative one bends the body to the other side.

    Raises:
        InputError: the mode is one of another scene, or does not move the body.

    Example:
        >>> edges = [gx.Fixed(film, edge) for edge in ("left", "right", "bottom", "top")]
        >>> equilibrium = gx.Equilibrium(gx.Scene(film, *edges))
        >>> result = equilibrium.find()
        >>> (mode,) = gx.analysis.modes(equilibrium, 1)
        >>> bent = gx.analysis.imperfect_mesh(film, mode, amplitude=1e-3)
        >>> bent.cells == film.mesh.cells
        True
    """
    own = mode.displacements.get(body.name, np.zeros((0, 3))).real
    nodes = body.space.dofmap.index_map.size_local
    check_on_all(
        body.comm,
        len(own) == nodes,
        f"imperfect_mesh: the mode has no displacements of '{body.name}'; give a mode of an "
        "equilibrium with this body.",
    )
    components = own.ravel()
    own_largest = 0.0
    if len(components):
        own_largest = float(components[np.abs(components).argmax()])
    # Of components that are equal up to round-off the first rank's counts.
    largest = max(body.comm.allgather(own_largest), key=abs)
    check(
        largest != 0,
        f"imperfect_mesh: '{body.name}' does not move in the mode; give another mode.",
    )
    domain = body.space.mesh
    shape = fem.Function(fem.functionspace(domain, ("Lagrange", body.order, (3,))))
    shape.x.array[: own.size] = (amplitude / largest * own).ravel()
    shape.x.scatter_forward()
    # At the nodes of the mesh, which may be fewer than those of the body.
    positions = MeshNodes(domain)
    moved = fem.Function(positions.space)
    if geometry_element(domain).degree == body.order:
        moved.x.array[:] = shape.x.array
    else:
        moved.interpolate(shape)
    displaced = domain.geometry.x.copy()
    displaced[positions.rows] += moved.x.array.reshape(-1, 3)
    return Mesh(with_points(domain, displaced), dict(body.mesh.groups))
