"""A reduced film: a film whose shape is a combination of modes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from dolfinx.common import IndexMap

from gossamer_fx.analysis.reduction.basis import Basis
from gossamer_fx.analysis.reduction.coordinates import ReducedCoordinates, coefficients
from gossamer_fx.analysis.reduction.reduced_energies import ReducedEnergy
from gossamer_fx.analysis.reduction.sampling import Sample
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.forms import backend
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array, Block, Port
from gossamer_fx.core.model.state import InitialState, State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.bodies.ports import global_node, interpolated
from gossamer_fx.mechanics.terms.element_energies import StoredEnergy
from gossamer_fx.mechanics.terms.masses import KineticEnergy, NodeKineticEnergy


class WeightedMeasure:
    """The measure ξ dx with the weights ξ of sampled cells; it multiplies integrands like a UFL
    measure.

    Args:
        dx: measure on the sampled cells.
        weight: ξ, constant in each cell.
    """

    def __init__(self, dx: ufl.Measure, weight: Expr) -> None:
        self._dx = dx
        self._weight = weight

    def __rmul__(self, integrand: Expr) -> ufl.Form:
        return (self._weight * integrand) * self._dx

    def metadata(self) -> Any:
        """Metadata of the measure, e.g. its quadrature degree."""
        return self._dx.metadata()


class SampledMesh(Mesh):
    """The mesh of the sampled cells, without named groups: the groups' cells may not be in it."""

    def group(self, name: str) -> Any:
        """Refuse a group of cells or nodes by name: its cells may not be among the sampled ones.

        Args:
            name: of the group, for any name.

        Raises:
            InputError: always.
        """
        raise InputError(
            f"A reduced film has no group '{name}': supports, creases and loads on groups need the "
            "film itself; tie "
            "points of a reduced one by `port_at`."
        )


class ReducedMembrane(Membrane):
    """A film with the unknowns c_i in x(X, t) = Σ φ_i(X) c_i(t); `reduce` makes it.

    It replaces the film in a scene: ports, joints, loads on its faces and outputs are those of the
    film.  Strains and loads on faces are integrated over the sampled cells.  The body has one node
    on rank 0 with the vectors c_0, ..., c_{r-1}; φ_0 = 1, so linear momentum is that of c_0 as in a
    rigid body.

    Args:
        made_from: the modes.
        over: the sampled cells.
        name: name in messages and outputs.

    Attributes:
        basis: the modes.
        sample: the sampled cells, with the error of sampling.
        outside: share of the initial shape that the modes do not represent, see `Basis.project`.
        port_nodes: global nodes of the film to which ports are attached.
    """

    def __init__(self, made_from: Basis, over: Sample, name: str) -> None:
        """Make a film over the sampled cells whose unknowns are the coefficients of modes.
        Collective."""
        film = made_from.film
        part, parents = backend.submesh_of(film.space.mesh, over.cells)
        super().__init__(SampledMesh(part), film.law, order=film.order, name=name)
        self._full = film
        self.basis = made_from
        self.sample = over
        self._modes = _modes_at_nodes(self.space, made_from, parents)
        self._restrict(parents)
        # One node, on rank 0
        self.block = Block(IndexMap(self.comm, int(self.comm.rank == 0)), 3 * made_from.size)
        q, v = film.initial_state()
        _, self.outside = made_from.project(q.reshape(-1, 3))
        self._reduced_start = (self.reduced(q), self.reduced(v))
        self.port_nodes: set[int] = set()

    def _restrict(self, parents: Any) -> None:
        """Weight the measures by the sampled cells' weights, and take the film's properties on
        these cells."""
        film = self._full
        cells = film.space.mesh.topology.index_map(2)
        weights = np.zeros(cells.size_local + cells.num_ghosts)
        weights[self.sample.cells] = self.sample.weights
        sampled = self.space.mesh
        self._weights = weights[parents][: sampled.topology.index_map(2).size_local]
        weight = _in_cells(sampled, weights[parents])
        self.dx = WeightedMeasure(self.dx, weight)
        self.mass_dx = WeightedMeasure(self.mass_dx, weight)
        for name, value in vars(film.constants).items():
            # Properties that vary from cell to cell are functions; others were set with the law.
            if isinstance(value, fem.Function):
                nodes = cell_nodes(value.function_space).ravel()
                size = value.function_space.dofmap.index_map_bs
                of_film = value.x.array.reshape(-1, size)[nodes]
                function = _in_cells(sampled, of_film[parents], value.ufl_shape)
                setattr(self.constants, name, function)
        direction = getattr(self.constants, "direction", None)
        if direction is not None:
            from gossamer_fx.mechanics.bodies.directions import set_axes

            set_axes(self.constants, direction, self._frame)

    def _orient(self) -> None:
        """The axes of the law are those of the film, see `_restrict`: the sample has no groups."""

    @property
    def full(self) -> Membrane:
        """The film that was reduced."""
        return self._full

    def coordinates(self, alpha: float) -> ReducedCoordinates:
        return ReducedCoordinates(self.space, alpha, self._modes)

    def initial_state(self) -> tuple[Array, Array]:
        """Owned coefficients [m] and their rates [m/s] that are nearest to the film's initial
        state."""
        return self._reduced_start

    def reduced(self, values: Array) -> Array:
        """Owned coefficients nearest to positions or velocities, in the norm of the mass.
        Collective.

        Args:
            values: at the owned nodes of the film that was reduced, flattened, in m or m/s.

        Returns:
            coefficients (3r,) of the r modes on rank 0, an empty array on other ranks.
        """
        c, _ = self.basis.project(values.reshape(-1, 3))
        owned = self.block.size * self.block.index_map.size_local
        return c.ravel()[:owned].copy()

    def terms(self, start: State) -> Iterable[Term]:
        """Yield kinetic and stored energy of the reduced film, as functions of the coefficients of
        its modes.

        The modes φ are orthogonal, φ_iᵀMφ_j = m δ_ij with the mass m [kg] of the film, so that the
        mass matrix is m times the identity."""
        mass = self.basis.mass * np.eye(self.basis.size)
        nodes = self.block.index_map.size_local
        yield NodeKineticEnergy(self, np.repeat(mass[None], nodes, axis=0))
        yield ReducedEnergy(
            self.name,
            self,
            self.measure,
            self.density,
            self.dx,
            self.law.quadratic,
            self.pieces,
            c_law=self.law.c_law(self.constants, self.comm),
            modes=self._modes,
            weights=self._weights,
        )

    def describe(self, node: int) -> str:
        return "its modes"

    def port(self, group: str) -> Port:
        """The point of a named group of one vertex of the film.  Collective."""
        node = global_node(self.full, self.full.mesh, group)
        return self._combined((node,), (1.0,))

    def port_at(self, point: Sequence[float]) -> Port:
        """The point of the film at the coordinates (3,) [m] of its stress-free shape.
        Collective."""
        on_film = interpolated(self.full, point)
        return self._combined(on_film.nodes, on_film.weights)

    def _combined(self, nodes: Sequence[int], weights: Sequence[float]) -> Port:
        """The port Σ_k weights[k] x(nodes[k]) as a combination of the coefficients.  Collective.

        Returns:
            the vector as a linear function of the coefficients of all modes.
        """
        self.port_nodes.update(nodes)
        start, end = self.full.block.index_map.local_range
        own = np.zeros(self.basis.size)
        for node, weight in zip(nodes, weights, strict=True):
            if start <= node < end:
                own += weight * self.basis.values[node - start]
        values = self.comm.allreduce(own)
        # All coefficients are vectors of the body's only node.
        return Port(
            self,
            (0,) * len(values),
            weights=tuple(values.tolist()),
            vectors=tuple(range(len(values))),
        )

    def reconstruct(self, function: fem.Function, unknowns: Array) -> None:
        """Set a function on the film's space from the unknowns, which rank 0 has.  Collective."""
        c = coefficients(self.comm, unknowns)
        function.x.array[:] = (self.basis.values @ c).ravel()


def check_reducible(film: Membrane) -> None:
    """Check that a film has strains and mass only, which is what a reduced film can have.

    Args:
        film: that a user wants to reduce.

    Raises:
        InputError: it has thermal expansion, bending stiffness, creases or contact.
    """
    check(
        film.thermal is None,
        f"reduce: '{film.name}' has a thermal expansion, which sampled cells do not have; leave "
        "thermal out.",
    )
    start = InitialState([film], film.comm)
    has_own_terms = type(film).terms is not Membrane.terms
    check(
        not has_own_terms
        and all(isinstance(term, KineticEnergy | StoredEnergy) for term in film.terms(start)),
        f"reduce: '{film.name}' has more than strains and mass (bending, creases, contact); those "
        "cannot be reduced.",
    )


def _in_cells(mesh: dmesh.Mesh, values: Array, shape: tuple[int, ...] = ()) -> fem.Function:
    """A function that is constant in each cell; ghost values come from the owners.  Collective.

    Args:
        values: (cells,), or (cells, k) of vectors, of owned and ghost cells, in any unit.
        shape: () or (k,).
    """
    function = fem.Function(fem.functionspace(mesh, ("Discontinuous Lagrange", 0, shape)))
    nodes = cell_nodes(function.function_space).ravel()
    size = function.function_space.dofmap.index_map_bs
    function.x.array.reshape(-1, size)[nodes] = values.reshape(len(nodes), size)
    function.x.scatter_forward()
    return function


def _modes_at_nodes(space: fem.FunctionSpace, basis: Basis, parents: Any) -> Array:
    """Φ (n, r) at the owned and ghost nodes of the sampled cells; dimensionless."""
    film_space = basis.film.space
    film_nodes = cell_nodes(film_space)
    nodes = cell_nodes(space)
    film_points = film_space.tabulate_dof_coordinates()
    points = space.tabulate_dof_coordinates()
    values = np.zeros((len(points), basis.size))
    for cell, parent in enumerate(parents):
        # A sampled cell may list its nodes in another order than the film's cell: they are matched
        # by their coordinates.
        here = points[nodes[cell]]
        there = film_points[film_nodes[parent]]
        distance = np.linalg.norm(here[:, None] - there[None], axis=2)
        nearest = film_nodes[parent][distance.argmin(axis=1)]
        values[nodes[cell]] = basis.values[nearest]
    return values
