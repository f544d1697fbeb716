"""A reduced film: a film whose shape is a combination of modes.

`reduce` makes it from recorded motions: 1. check that the film has strains, bending and mass only;
2. compute the modes (`basis`) and their bending energy (`bending`); 3. choose the cells over which
strains are integrated (`sampling`); 4. make the body.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Annotated, Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from dolfinx.common import IndexMap

from gossamer_fx.analysis.reduction.basis import Basis, Shapes, make_basis
from gossamer_fx.analysis.reduction.bending import BendingOfModes, ModalBending, bending_of_modes
from gossamer_fx.analysis.reduction.reduced_energies import (
    ReducedCoordinates,
    ReducedEnergy,
    coefficients,
)
from gossamer_fx.analysis.reduction.sampling import Sample, every_cell, sample_cells
from gossamer_fx.core.checks.arguments import Range, check_arguments, collective
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.forms import backend
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.tied_strain import tied_strain
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array, Block, Port, Vector
from gossamer_fx.core.model.state import InitialState, State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.bodies.meshed import global_node, global_nodes
from gossamer_fx.mechanics.bodies.plate import Plate
from gossamer_fx.mechanics.bodies.triple_products import TripleProductEnergy
from gossamer_fx.mechanics.terms.element_energies import StoredEnergy
from gossamer_fx.mechanics.terms.masses import KineticEnergy
from gossamer_fx.mechanics.terms.quadratic_energies import QuadraticEnergy
from gossamer_fx.mechanics.terms.rows import AttachedKineticEnergy


class WeightedMeasure:
    """The measure ξ dx with the weights ξ of sampled cells; it multiplies integrands like a UFL
    measure."""

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

    def group(self, name: str, user: str = "group") -> Any:
        """Refuse a group of cells or nodes by name: its cells may not be among the sampled ones."""
        raise InputError(
            f"{user}: a reduced film has no group '{name}'; "
            "supports, creases and loads on groups need the film itself; "
            "tie points of a reduced one by `port_at`."
        )


class ReducedMembrane(Membrane):
    """A film with the unknowns c_i in x(X, t) = Σ φ_i(X) c_i(t); `reduce` makes it.

    It replaces the film in a scene: ports, joints, loads on its faces and outputs are those of the
    film.  Strains and loads on faces are integrated over the sampled cells.  The body has one node
    on rank 0 with the vectors c_0, ..., c_{r-1}; φ_0 = 1, so linear momentum is that of c_0 as in a
    rigid body.

    Attributes:
        basis: the modes.
        sample: the sampled cells, with the error of sampling.
        bending: of the modes of a plate, see `reduction.bending`; None of a film without it.
        outside: share of the initial shape that the modes do not represent, see `Basis.project`.
        port_nodes: global nodes of the film to which ports are attached.
    """

    def __init__(
        self, made_from: Basis, over: Sample, bending: ModalBending | None, name: str
    ) -> None:
        film = made_from.film
        part, parents = backend.submesh_of(film.space.mesh, over.cells)
        super().__init__(SampledMesh(part), film.law, order=film.order, name=name)
        self._full = film
        self.basis = made_from
        self.sample = over
        self.bending = bending
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
        self._weight = _in_cells(sampled, weights[parents])
        self.dx = WeightedMeasure(self.dx, self._weight)
        self.mass_dx = WeightedMeasure(self.mass_dx, self._weight)
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
            from gossamer_fx.mechanics.bodies.properties import set_axes

            set_axes(self.constants, direction, self._frame)

    def _orient(self) -> None:
        """The axes of the law are those of the film, see `_restrict`: the sample has no groups."""

    def surface_measure(self, degree: int) -> WeightedMeasure:
        return WeightedMeasure(super().surface_measure(degree), self._weight)

    def strain_from_mesh(self, x: Expr) -> Expr:
        if self._full.bends:
            return tied_strain(self.mesh.domain, x, self._frame)
        return super().strain_from_mesh(x)

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
        """Coefficients (3r,) nearest to positions [m] or velocities [m/s] at the owned nodes of the
        film, in the norm of the mass; on rank 0.  Collective."""
        c, _ = self.basis.project(values.reshape(-1, 3))
        owned = self.block.size * self.block.index_map.size_local
        return c.ravel()[:owned].copy()

    def terms(self, start: State) -> Iterable[Term]:
        """Kinetic and stored energy, as functions of the coefficients of modes.  As φ_iᵀMφ_j = m
        δ_ij with the mass m [kg] of the film, the mass matrix is m times the identity."""
        size = self.basis.size
        modes = tuple(Port(self, (0,), weights=(1.0,), vectors=(k,)) for k in range(size))
        yield AttachedKineticEnergy([modes], self.basis.mass * np.eye(size)[None])
        # What both kinds of stored energy take.
        stored: dict[str, Any] = {
            "name": self.name,
            "body": self,
            "measure": self.measure,
            "density": self.density,
            "dx": self.dx,
            "quadratic": self.law.quadratic,
            "pieces": self.pieces,
            "c_law": self.law.c_law(self.constants, self.comm),
        }
        if self.bending is None:
            yield ReducedEnergy(**stored, modes=self._modes, weights=self._weights)
            return
        # The strains of a plate are not those of `points`.
        yield StoredEnergy(**stored)
        yield BendingOfModes(f"{self.name} bending", self, self.bending)

    def describe(self, node: int) -> str:
        return "its modes"

    @check_arguments
    @collective
    def port(self, group: str) -> Port:
        node = global_node(self.full, group)
        return self._combined((node,), (1.0,))

    @check_arguments
    @collective
    def ports(self, group: str) -> list[Port]:
        return [self._combined((node,), (1.0,)) for node in global_nodes(self.full, group)]

    @check_arguments
    @collective
    def port_at(self, point: Vector, *, snap: bool = False) -> Port:
        on_film = self.full.port_at(point, snap=snap)
        return self._combined(on_film.nodes, on_film.weights)

    def _combined(self, nodes: Sequence[int], weights: Sequence[float]) -> Port:
        """The port Σ_k weights[k] x(nodes[k]) as a linear function of the coefficients of all
        modes. Collective."""
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
    """Check that a film has strains, bending and mass only, which is what a reduced film can
    have."""
    check(
        film.thermal is None,
        f"reduce: '{film.name}' has a thermal expansion, which sampled cells do not have; "
        "leave thermal out.",
    )
    check(
        getattr(film, "shape", None) is None,
        f"reduce: the mesh of '{film.name}' is curved; give a plate with plane triangles.",
    )
    start = InitialState([film], film.comm)
    has_own_terms = type(film).terms not in (Membrane.terms, Plate.terms)
    known = KineticEnergy | StoredEnergy | QuadraticEnergy | TripleProductEnergy
    check(
        not has_own_terms and all(isinstance(term, known) for term in film.terms(start)),
        f"reduce: '{film.name}' has more than strains, bending and mass (creases, contact); "
        "those cannot be reduced.",
    )


def _in_cells(mesh: dmesh.Mesh, values: Array, shape: tuple[int, ...] = ()) -> fem.Function:
    """A function of values (cells, *shape) in owned and ghost cells; ghosts get those of the
    owners. Collective."""
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


@check_arguments
def reduce(
    body: Membrane,
    motions: Sequence[Shapes],
    *,
    modes: Annotated[int, Range(1)],
    cells: Annotated[int, Range(1)] | None = None,
) -> ReducedMembrane:
    """A reduced model of a film: 3 · (modes + 3) unknowns that move as the film did in `motions`.

    A film that is not plane has 3 · (modes + 4) unknowns.  The modes are mass-weighted singular
    vectors of all shapes, scalar fields with vectors as unknowns, so that energy, momentum and
    angular momentum are conserved; see `reduction.basis`.  The reduced film has the initial state,
    law and name of the film, and replaces it in a new scene.  Collective.

    Args:
        body: the film, or a plate on a flat mesh, whose bending is not sampled; it may not have
            creases or contact.
        motions: `Snapshots` of runs, `ModeShapes`, or own `Shapes`.
        modes: number of singular vectors, in addition to those of homogeneous motions; ≥ 1.
        cells: largest number of cells of each rank over which strains are integrated, see
            `reduction.sampling`; None for all cells.  Loads on faces act on these cells, with their
            weights: the sum of the forces is near that of all cells, their moment less so.

    Raises:
        InputError: there are no shapes, they are of another mesh or hold fewer modes, the film has
            more than strains, bending and mass, or `cells` are given and a shape is unstable.

    Example:
        >>> shapes = gx.reduction.Snapshots(film)
        >>> scene = gx.Scene(film, gx.Fixed(film, "left"), gx.Gravity(film))
        >>> gx.Simulation(scene, gx.Midpoint(dt=1e-3), outputs=[shapes]).run(until=5e-3)
        >>> reduced = gx.reduction.reduce(film, [shapes], modes=2)
        >>> reduced.block.size
        15
    """
    check_reducible(body)
    shapes = [shape for motion in motions for shape in motion.positions]
    basis = make_basis(body, shapes, modes)
    bending = bending_of_modes(basis)
    # Without sampling the strains are integrated over all cells, each with the weight one.
    sample = every_cell(body) if cells is None else sample_cells(basis, cells, bending)
    return ReducedMembrane(basis, sample, bending, body.name)
