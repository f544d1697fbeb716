"""Branches in parallel to the elastic law of a body, whose strains are history variables at the
quadrature points: those that relax (`viscoelasticity`) and those that slide (`internal_friction`).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from dolfinx import fem

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.backend import cell_nodes, interpolation_points
from gossamer_fx.core.model.body import Array, MeshBody
from gossamer_fx.mechanics.terms.assembly import Assembly, HistoryVariables
from gossamer_fx.mechanics.terms.coordinates import Coordinates
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule
from gossamer_fx.mechanics.terms.element_energies import (
    ElementEnergies,
    ViscousDissipation,
    ViscousForces,
    quadrature_element,
)


def check_branches(what: str, body: Any) -> None:
    """Raise `InputError`, which begins with `what`, unless each branch has one of each of two kinds
    of numbers, given by their names, and the body is one whose strain alone has a stress."""
    check(
        not body.bends,
        f"{what}: '{body.name}' is a Plate, whose bending branches do not act on; "
        "use a body that does not bend.",
    )
    check(
        body.thermal is None,
        f"{what}: '{body.name}' has thermal expansion; leave one of them out.",
    )


class BranchForces(ViscousForces):
    """Stresses, loss and history of the branches of one term.

    Attributes:
        in_step: whether the next state that is committed is the end of a step.
        history: of each branch, a row for each component at each point of the n cells that this
            rank owns, (rows, n).
        mean: the stress of all branches in the mean of the last step, in the same way.
    """

    def __init__(self, term: ViscousDissipation, at: Coordinates, rule: StressRule) -> None:
        """Make what shows stresses, and compile.  Collective."""
        mesh = at.q1.function_space.mesh
        (size,) = term.measure(at.q1).ufl_shape
        self.in_step = False
        self.history: list[Array] = []
        # Stresses at the quadrature points, for fields
        self._shown = fem.Function(fem.functionspace(mesh, self._element(term, mesh, size)))
        # Quadrature points of each owned cell
        topology = mesh.topology
        owned = topology.index_map(topology.dim).size_local
        self._rows = cell_nodes(self._shown.function_space)[:owned]
        self.mean = self._nothing(size)
        super().__init__(term, at, rule)

    @staticmethod
    def _element(term: ViscousDissipation, mesh: Any, size: int) -> Any:
        """An element of values (size,) at the quadrature points."""
        return quadrature_element(mesh, term.dx.metadata(), (size,))

    def _nothing(self, size: int) -> Array:
        """Zeros in the order of `history`, of values (size,) at each point."""
        return np.zeros((self._rows.shape[1] * size, len(self._rows)))

    @abstractmethod
    def begin_step(self, h: float) -> None:
        """Start a step of length h [s]."""

    @abstractmethod
    def commit(self) -> None:
        """Take the accepted state, and at the end of a step the history variables there."""

    @abstractmethod
    def energy(self) -> float:
        """Stored energy [J] of the branches, this rank's share."""

    @abstractmethod
    def show_end(self) -> None:
        """Set the shown stress to that of the accepted state."""

    def _put(self, values: Array, function: fem.Function) -> None:
        """Copy values in the order of `history` to a function of the forms."""
        (size,) = function.function_space.value_shape
        ordered = values.T.reshape(*self._rows.shape, size)
        function.x.array.reshape(-1, size)[self._rows] = ordered

    def _values_of(self, function: fem.Function) -> Array:
        """The values of a function at the points, in the order of `history`."""
        (size,) = function.function_space.value_shape
        rows = function.x.array.reshape(-1, size)[self._rows]
        return rows.reshape(len(self._rows), -1).T

    def shown_stress(self, at_end: bool) -> tuple[fem.Function, Callable[[], None]]:
        """The stress of the branches at the end of the last step, or in its mean, as a
        discontinuous function, and what sets it through the values at the quadrature points of each
        cell."""
        space = self._shown.function_space
        (size,) = space.value_shape
        order = self.term.body.space.ufl_element().degree - 1
        smooth = fem.functionspace(space.mesh, ("Discontinuous Lagrange", order, (size,)))
        function = fem.Function(smooth)
        [shapes] = smooth.ufl_element().sub_elements[0].tabulate(0, interpolation_points(space))
        through_points = np.linalg.pinv(shapes)
        nodes = cell_nodes(smooth)[: len(self._rows)]

        def update() -> None:
            at_points = self.mean
            if at_end:
                self.show_end()
                at_points = self._values_of(self._shown)
            values = at_points.T.reshape(len(nodes), -1, size)
            function.x.array.reshape(-1, size)[nodes] = through_points @ values
            function.x.scatter_forward()

        return function, update


class BranchEnergies(ElementEnergies, HistoryVariables):
    """All terms of one kind of branches in a scene."""

    def __init__(self, terms: Sequence[ViscousDissipation], system: Assembly) -> None:
        self.branches: list[BranchForces] = []
        super().__init__(terms, system)

    @abstractmethod
    def _branch_forces(
        self, term: ViscousDissipation, at: Coordinates, rule: StressRule
    ) -> BranchForces:
        """The stresses of a term."""

    def _viscous_forces(
        self, term: ViscousDissipation, at: Coordinates, rule: StressRule
    ) -> ViscousForces:
        forces = self._branch_forces(term, at, rule)
        self.branches.append(forces)
        return forces

    def begin_step(self, t: float) -> None:
        super().begin_step(t)
        for forces in self.branches:
            forces.in_step = True
            forces.begin_step(self._system.h)

    def take_time(self, t: float) -> None:
        # A state is restored: what is committed next is not the end of a step.
        for forces in self.branches:
            forces.in_step = False

    def commit(self) -> None:
        for forces in self.branches:
            forces.commit()
            forces.in_step = False

    def energies(self) -> dict[str, float]:
        return {forces.term.name: forces.energy() for forces in self.branches}

    def without_gradient(self) -> str:
        for forces in self.branches:
            return f"the stress of '{forces.term.name}' depends on its history; leave it out"
        return ""

    def get_history(self) -> dict[str, Any]:
        """Empty: all history is that of cells."""
        return {}

    def shape_history(self) -> dict[str, Any]:
        return self.get_history()

    def set_history(self, state: dict[str, Any]) -> None:
        """Nothing to do: the arrays of `cell_history` have been written to."""

    def cell_history(self) -> dict[str, tuple[MeshBody, Array]]:
        """The history variables by number of the term, of its branch, and of the row in `history`;
        as those of one more branch the mean stresses."""
        found: dict[str, tuple[MeshBody, Array]] = {}
        kind = type(self).__name__
        for i, forces in enumerate(self.branches):
            for k, z in enumerate([*forces.history, forces.mean]):
                for j in range(len(z)):
                    found[f"{kind} {i} {k} {j}"] = forces.term.body, z[j]
        return found

    def branches_of(self, body: MeshBody) -> list[BranchForces]:
        return [forces for forces in self.branches if forces.term.body is body]
