"""Maps of wrinkles that a mesh does not resolve: slope, amplitude and direction of the crests.

A law without compression replaces wrinkles by a strain that costs no energy.  With the stress S of
a cell and the compliance F of taut film, this wrinkling strain is

    A = F S - e,    A = a n⊗n in wrinkled film, n across the crests                           (1)

Neighbouring cells share it unevenly: the equations of a cell fix averages over its neighbourhood
only, so that wrinkled and taut cells may alternate like a chessboard on any mesh.  The maps are
therefore made of the mean of A over the cells around each node, taken twice.

For wrinkles w = W sin(π s/L), whose excess of length is the trace a of (1),

    slope      π W/L = 2 √a                                                                   (2)
    amplitude  W = 2 L √a/π,    L = √π (B/T)^(1/4) √ℓ                                         (3)

with the half wavelength L of a stretched sheet of bending stiffness B, tension T and length ℓ
(Cerda & Mahadevan, Phys. Rev. Lett. 90 (2003) 074302, doi:10.1103/PhysRevLett.90.074302).  ℓ is the
square root of the area of the film, so that (3) is an estimate: wrinkles that are n times shorter
have 1/√n of it.

An orthotropic film bends across its crests, along n: B = (n⊗n):D:(n⊗n), with the stiffness D of a
plate of its material, uniform across the thickness.  As a mean over cells with different n, B is
weighted by a.
"""

from __future__ import annotations

import math

import numpy as np
import ufl
from dolfinx import fem, la
from dolfinx.mesh import Mesh

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.backend import cell_nodes, interpolation_points
from gossamer_fx.core.forms.compilation import compile_expression
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.strain_path import energy_gradient
from gossamer_fx.core.mesh.quality import area_vectors, corner_points
from gossamer_fx.core.model.body import Array, MeshBody
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.records.fields.body_shape import BodyShape
from gossamer_fx.solve.system.system import System

# Number of times that means over the cells around each vertex are taken.
SMOOTHINGS = 2

# Components of a symmetric tensor (3, 3), then further columns: the tension T, the excess a, and B
# a.
SYMMETRIC = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
TENSION = 6
EXCESS = 7
BENDING = 8
COLUMNS = 9

# Tension per width [N/m] below which the film is slack, so that (3) has no wavelength.
LEAST_TENSION = 1e-12

# Excess of length below which film is taut, so that it has no bending stiffness across crests:
# round-off of strains.
LEAST_EXCESS = 1e-15


class WrinkleMap:
    """Sets a function on a film to the map of wrinkles that has its name; compiled once."""

    def __init__(self, function: fem.Function, film: MeshBody, system: System) -> None:
        """Check the film's law, and compile the expressions of the map; collective."""
        self._function = function
        self._shape = BodyShape(system, film)
        body = self._shape.body
        _check_law(body)
        domain = body.space.mesh
        self._cellwise = fem.Function(
            fem.functionspace(domain, ("Discontinuous Lagrange", 0, (COLUMNS,)))
        )
        points = interpolation_points(self._cellwise.function_space)
        self._expression = compile_expression(_wrinkle_quantities(self._shape), points)
        self._linear = fem.Function(
            fem.functionspace(domain, ("Lagrange", 1, tuple(function.ufl_shape)))
        )

    def update(self) -> None:
        """Set the function to its map in the accepted state.  Collective.

        - "wrinkle_slope": largest slope [-] of the wrinkles; 0 where the film is taut.
        - "wrinkle_amplitude": amplitude [m]; 0 where the film is taut, and where it is slack, with
          a tension of at most `LEAST_TENSION` or a negative one.
        - "wrinkle_direction": unit vector (3,) in the film along the crests; zero where the film
          has no excess of length.

        Values are computed at the vertices and are linear between them.
        """
        self._shape.update()
        body = self._shape.body
        # At the n local vertices: wrinkling strain (n, 3, 3) [-], tension (n,) [N/m] and bending
        # stiffness across the crests (n,) [N m].
        tensors, tension, bending = self._smoothed()
        eigenvalues, vectors = np.linalg.eigh(tensors)
        # Excess of length a of equation (2) of the module; negative eigenvalues are round-off or
        # come from the means.
        excess = np.maximum(eigenvalues, 0.0).sum(axis=1)
        slope = 2 * np.sqrt(excess)
        at_vertices: Array
        if self._function.name == "wrinkle_slope":
            at_vertices = slope
        elif self._function.name == "wrinkle_amplitude":
            at_vertices = slope * _half_wavelength(body, tension, bending) / math.pi
        else:
            at_vertices = _crests(self._shape, tensors, vectors)
        # Linear between the vertices.
        self._linear.x.array[:] = at_vertices.ravel()
        self._function.interpolate(self._linear)

    def _smoothed(self) -> tuple[Array, Array, Array]:
        """Return wrinkling strain, tension and bending stiffness at the n local vertices, as means
        over the cells around them; collective.

        Returns:
            wrinkling strain A in space (n, 3, 3) [-], tension T (n,) [N/m], and bending stiffness B
            across the crests (n,) [N m], zero where the film is taut.
        """
        cellwise = self._cellwise
        cellwise.interpolate(self._expression)
        cellwise.x.scatter_forward()
        # Values of all local cells, ghosts included, in the order of the cells.
        rows = cell_nodes(cellwise.function_space).ravel()
        values = cellwise.x.array.reshape(-1, COLUMNS)[rows]
        values = _smooth(cellwise.function_space.mesh, values)
        tensors = np.zeros((len(values), 3, 3))
        for k, (i, j) in enumerate(SYMMETRIC):
            tensors[:, i, j] = values[:, k]
            tensors[:, j, i] = values[:, k]
        excess = values[:, EXCESS]
        has_excess = excess > LEAST_EXCESS
        bending = np.where(has_excess, values[:, BENDING], 0.0) / np.where(has_excess, excess, 1.0)
        return tensors, values[:, TENSION], bending


def _check_law(film: Membrane) -> None:
    """Refuse films whose law does not give the taut strain of a stress, or no bending stiffness."""
    check(
        film.law.has_wrinkle_maps,
        f"'{film.name}' has no maps of wrinkles, as its law is {type(film.law).__name__}; use the "
        "field 'state', or another law, e.g. TensionField.",
    )


def _wrinkle_quantities(shape: BodyShape) -> Expr:
    """Return what a map of wrinkles needs in each cell, as a UFL expression (9,).

    Returns:
        six components of the wrinkling strain A in space, in the order of `SYMMETRIC`; tension T
        [N/m], the larger principal stress; excess of length a = tr A [-]; and a B [N m], B the
        bending stiffness across the crests.
    """
    film = shape.body
    # Strains and stresses are vectors (3,) in the frame of the film, strains with twice the shear.
    elastic = shape.elastic_strain()
    stress = energy_gradient(film.density, elastic)
    strain = film.law.taut_strain(stress, film.constants) - elastic
    in_frame = ufl.as_matrix([[strain[0], strain[2] / 2], [strain[2] / 2, strain[1]]])
    deformation = film.deformation(shape.q)
    in_space = ufl.dot(deformation, ufl.dot(in_frame, deformation.T))
    mean = (stress[0] + stress[1]) / 2
    radius = ufl.sqrt(((stress[0] - stress[1]) / 2) ** 2 + stress[2] ** 2)
    excess = in_frame[0, 0] + in_frame[1, 1]
    has_excess = ufl.gt(excess, LEAST_EXCESS)
    # n⊗n of wrinkled film; of slack film a mean of all directions in which it is too long.
    directions = in_frame / ufl.conditional(has_excess, excess, 1.0)
    moment = film.law.bending_stiffness(film.constants).moment(directions)
    bending = ufl.conditional(has_excess, excess * ufl.inner(moment, directions), 0.0)
    numbers = [in_space[i, j] for i, j in SYMMETRIC]
    weight = ufl.conditional(has_excess, excess, 0.0)
    return ufl.as_vector([*numbers, mean + radius, weight, bending])


def _smooth(domain: Mesh, in_cells: Array) -> Array:
    """Return values at the vertices: means over the cells around them, taken several times.

    Means are weighted by area.  Collective.

    Args:
        in_cells: values (cells, k) of all local cells, ghosts included, in any unit.

    Returns:
        values (vertices, k), ghosts included.
    """
    at_vertices = fem.functionspace(domain, ("Lagrange", 1))
    dofmap = at_vertices.dofmap
    nodes = cell_nodes(at_vertices)
    own = domain.topology.index_map(2).size_local
    areas = np.linalg.norm(area_vectors(corner_points(domain)), axis=1)

    def mean_at_vertices(values: Array) -> Array:
        """Average values of cells at the vertices, weighted by area.  Collective.

        Args:
            values: (cells, k) of local cells, in any unit.

        Returns:
            (vertices, k) at local vertices, ghosts included.
        """
        sums = la.vector(dofmap.index_map, values.shape[1] + 1)
        weighted = np.column_stack([values[:own], np.ones(own)]) * areas[:own, None]
        table = sums.array.reshape(-1, values.shape[1] + 1)
        # Each rank adds its own cells; the sums of shared vertices are completed by the exchange.
        for corner in range(3):
            np.add.at(table, nodes[:own, corner], weighted)
        sums.scatter_reverse(la.InsertMode.add)
        sums.scatter_forward()
        return table[:, :-1] / table[:, -1:]

    found = mean_at_vertices(in_cells)
    for _ in range(SMOOTHINGS - 1):
        found = mean_at_vertices(found[nodes].mean(axis=1))
    return found


def _half_wavelength(film: Membrane, tension: Array, bending: Array) -> Array:
    """Return the half wavelength L = √π (B/T)^(1/4) √ℓ of wrinkles, equation (3) of the module.

    ℓ is the square root of the area of the film.  Collective.

    Args:
        tension: T (n,) [N/m] at the n local vertices, of any sign.
        bending: B (n,) [N m] there, not negative.

    Returns:
        L (n,) [m]; 0 where the film is slack, T ≤ `LEAST_TENSION`, and where B is 0.
    """
    domain = film.space.mesh
    own = domain.topology.index_map(2).size_local
    areas = np.linalg.norm(area_vectors(corner_points(domain))[:own], axis=1)
    length = math.sqrt(film.comm.allreduce(float(areas.sum())))
    is_taut = tension > LEAST_TENSION
    ratio = np.where(is_taut, bending / np.where(is_taut, tension, 1.0), 0.0)
    return math.sqrt(math.pi * length) * ratio**0.25


def _crests(shape: BodyShape, tensors: Array, vectors: Array) -> Array:
    """Return unit vectors along the crests at the local vertices: in the film, across the direction
    n in which it is too long.  Collective.

    Args:
        tensors: wrinkling strain in space (n, 3, 3), symmetric.
        vectors: its eigenvectors (n, 3, 3) as columns, that of the largest eigenvalue last.

    Returns:
        (n, 3); zero where there are no wrinkles, as the trace of the strain is not positive.
    """
    across = vectors[:, :, -1]
    normals = _normals(shape)
    crests = np.cross(normals, across)
    lengths = np.linalg.norm(crests, axis=1, keepdims=True)
    has_wrinkles = np.trace(tensors, axis1=1, axis2=2) > 0
    unit = crests / np.where(lengths > 0, lengths, 1.0)
    # A direction and its opposite are the same: the largest component is positive.
    largest = np.abs(unit).argmax(axis=1)
    signs = np.sign(unit[np.arange(len(unit)), largest])
    return unit * signs[:, None] * has_wrinkles[:, None]


def _normals(shape: BodyShape) -> Array:
    """Mean normals (n, 3) [m²] of the deformed film at the local vertices, not of unit length."""
    space = shape.body.space
    positions = shape.q.x.array.reshape(-1, 3)
    corners = positions[cell_nodes(space)[:, :3]]
    return _smooth(space.mesh, area_vectors(corners))
