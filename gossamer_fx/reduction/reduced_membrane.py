"""A film whose shape is a combination of modes: the reduced model of a sail."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from dolfinx.common import IndexMap

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.bodies.ports import global_node, interpolated
from gossamer_fx.checks.errors import InputError, check
from gossamer_fx.forms import backend
from gossamer_fx.forms.kinematics import Expr
from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.mesh.mesh import Mesh
from gossamer_fx.model.body import Array, Block, Port
from gossamer_fx.model.state import InitialState, State
from gossamer_fx.model.terms import Term
from gossamer_fx.reduction.basis import Basis
from gossamer_fx.reduction.coordinates import ReducedCoordinates, coefficients
from gossamer_fx.reduction.reduced_energies import ReducedEnergy
from gossamer_fx.reduction.sampling import Sample
from gossamer_fx.terms.element_energies import StoredEnergy
from gossamer_fx.terms.masses import KineticEnergy, NodeKineticEnergy


class WeightedMeasure:
    """∫ ξ · dx with the weights ξ of sampled cells: integrals over few cells that stand for those over all."""

    def __init__(self, dx: ufl.Measure, weight: Expr) -> None:
        self._dx, self._weight = dx, weight

    def __rmul__(self, integrand: Expr) -> ufl.Form:
        return (self._weight * integrand) * self._dx

    def metadata(self) -> Any:
        return self._dx.metadata()


class SampledMesh(Mesh):
    """The sampled cells: what the groups of the whole mesh name is not among them."""

    def group(self, name: str) -> Any:
        raise InputError(
            f"A reduced film has no group '{name}': supports, creases and loads on groups need the film itself; tie "
            "points of a reduced one by `port_at`."
        )


class ReducedMembrane(Membrane):
    """A film with few unknowns: x(X, t) = Σ φ_i(X) c_i(t); made by `reduce`.

    It takes the place of the film in a scene: ports, joints, loads on its faces and outputs are as the film's.  Its
    strains and the loads on its faces are integrated over the sampled cells.  Its node is c = (c_0, ..., c_{r-1}) with
    φ_0 = 1, so linear momentum is that of c_0, as in a rigid body.

    `full` is the film that was reduced; `basis` holds its modes; `sample` the cells, with the error of sampling.
    """

    def __init__(self, made_from: Basis, over: Sample, name: str) -> None:
        basis, sample = made_from, over
        full = basis.film
        whole = full.space.mesh
        part, parents = backend.part_of(whole, sample.cells)
        super().__init__(SampledMesh(part), full.law, order=full.order, name=name)
        self._full = full
        self.basis = basis
        self.sample = sample
        self._modes = _at_nodes_of(self.space, basis, parents)
        weight = np.zeros(
            whole.topology.index_map(2).size_local + whole.topology.index_map(2).num_ghosts
        )
        weight[sample.cells] = sample.weights
        self._weights = weight[parents][: part.topology.index_map(2).size_local]
        weights = _in_cells(part, weight[parents])
        for number, value in vars(full.constants).items():
            if isinstance(value, fem.Function):  # a property that varies from cell to cell
                there = value.x.array[cell_nodes(value.function_space).ravel()]
                setattr(self.constants, number, _in_cells(part, there[parents]))
        self.dx = WeightedMeasure(self.dx, weights)
        self.mass_dx = WeightedMeasure(self.mass_dx, weights)
        self.block = Block(IndexMap(self.comm, 1 if self.comm.rank == 0 else 0), 3 * basis.size)
        q, v = full.initial_state()
        self.outside = basis.project(q.reshape(-1, 3))[1]
        self._reduced_start = self.reduced(q), self.reduced(v)
        self.port_nodes: set[int] = set()  # of the full film

    @property
    def full(self) -> Membrane:
        """The film that was reduced."""
        return self._full

    def coordinates(self, alpha: float) -> ReducedCoordinates:
        return ReducedCoordinates(self.space, alpha, self._modes)

    def initial_state(self) -> tuple[Array, Array]:
        return self._reduced_start

    def reduced(self, values: Array) -> Array:
        """Owned coefficients of owned positions or velocities of the full film: the nearest in the norm of the mass."""
        c, _ = self.basis.project(values.reshape(-1, 3))
        return c.ravel()[: self.block.size * self.block.index_map.size_local].copy()

    def terms(self, start: State) -> Iterable[Term]:
        mass = self.basis.mass * np.eye(self.basis.size)
        yield NodeKineticEnergy(
            self, np.repeat(mass[None], self.block.index_map.size_local, axis=0)
        )
        yield ReducedEnergy(
            self.name,
            self,
            self.measure,
            self.density,
            self.dx,
            self.law.quadratic,
            self.pieces,
            modes=self._modes,
            weights=self._weights,
        )

    def describe(self, node: int) -> str:
        return "its modes"

    def port(self, group: str) -> Port:
        return self._combined((global_node(self.full, self.full.mesh, group),), (1.0,))

    def port_at(self, point: Sequence[float]) -> Port:
        there = interpolated(self.full, point)
        return self._combined(there.nodes, there.weights)

    def _combined(self, nodes: Sequence[int], weights: Sequence[float]) -> Port:
        """Σ_k weights[k] x(nodes[k]) as a combination of the coefficients; the same on every rank."""
        self.port_nodes.update(nodes)
        start, end = self.full.block.index_map.local_range
        own = [
            (node - start, weight)
            for node, weight in zip(nodes, weights, strict=True)
            if start <= node < end
        ]
        values = sum(
            (weight * self.basis.values[node] for node, weight in own), np.zeros(self.basis.size)
        )
        values = self.comm.allreduce(values)
        return Port(
            self,
            (0,) * len(values),
            weights=tuple(values.tolist()),
            vectors=tuple(range(len(values))),
        )

    def reconstruct(self, function: fem.Function, unknowns: Array) -> None:
        """Set a function on the full film's space from the unknowns, which rank 0 has."""
        function.x.array[:] = (self.basis.values @ coefficients(self.comm, unknowns)).ravel()


def _in_cells(mesh: dmesh.Mesh, values: Array) -> fem.Function:
    """A function that is constant in each cell; those of ghosts are fetched."""
    function = fem.Function(fem.functionspace(mesh, ("Discontinuous Lagrange", 0)))
    function.x.array[cell_nodes(function.function_space).ravel()] = values
    function.x.scatter_forward()
    return function


def _at_nodes_of(space: fem.FunctionSpace, basis: Basis, parents: Any) -> Array:
    """Φ at the owned and ghost nodes of a space on some cells of the film; `parents` are the cells there."""
    there, here = cell_nodes(basis.film.space), cell_nodes(space)
    x, X = space.tabulate_dof_coordinates(), basis.film.space.tabulate_dof_coordinates()
    values = np.zeros((len(x), basis.size))
    for cell, parent in enumerate(parents):
        # a cell may list its nodes in another order than its parent does
        distance = np.linalg.norm(x[here[cell]][:, None] - X[there[parent]][None], axis=2)
        values[here[cell]] = basis.values[there[parent][distance.argmin(axis=1)]]
    return values


def check_reducible(film: Membrane) -> None:
    """Refuse what the reduced model has no form for."""
    start = InitialState([film], film.comm)
    check(
        type(film).terms is Membrane.terms
        and all(isinstance(t, KineticEnergy | StoredEnergy) for t in film.terms(start)),
        f"reduce: '{film.name}' has more than strains and mass (bending, creases, contact); those cannot be reduced.",
    )
