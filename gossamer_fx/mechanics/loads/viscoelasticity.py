"""Viscoelastic films, cables and beams: Maxwell branches in parallel to an elastic law.

Problem.  The stress of a polymer film relaxes under a held strain.  A Prony series of its stiffness
is measured,

    C(t) = C (1 + Σ r_k exp(-t/τ_k)),                                                            (1)

and a step of any length has to conserve energy but for the loss.

Idea.  Each branch has an elastic strain z_k, whose rate is that of the strain e less z_k/τ_k, and
the energy r_k ψ(z_k), where ψ is the energy of the law with the stiffness C.  In a step of length h
with E = exp(-h/τ) let y = z0 + ½ Δe.  Then

    z1 = (1 + E) y - z0 = E z0 + ½ (1 + E) Δe                                                    (2)
    S_mean = ½ (1 + E) r ψ'(y)                                                                   (3)
    S_mean·Δe = r (ψ(z1) - ψ(z0)) + r (1 - E²) ψ(y)                                              (4)

(4) holds exactly, as ψ is quadratic; its last part, which is not negative, is the loss.  Under a
held strain (2) is exact for any h; else it is of second order in h, as it is the midpoint rule with
2 tanh(h/2τ) in place of h/τ.  Stresses are linear in the strain, so that momenta are conserved as
those of damping are.  Law and branches together have the stress ψ'(e + Σ r_k z_k), of a step that
at the means of e and z_k; fields and probes show it.

At rest the branches have relaxed: a search for equilibrium has the law alone.

Source of (1), "generalised Maxwell" or Wiechert model: J. D. Ferry, Viscoelastic properties of
polymers, Wiley 1980.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from dolfinx import fem

from gossamer_fx.core.checks.arguments import check_arguments, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.backend import cell_nodes, interpolation_points
from gossamer_fx.core.forms.cell_loops import tabulation
from gossamer_fx.core.forms.compilation import compile_expression, compile_form, constant
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.strain_path import gradient
from gossamer_fx.core.model.body import Array, MeshBody
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import OnBody, Term
from gossamer_fx.mechanics.bodies.beam import Beam
from gossamer_fx.mechanics.bodies.cable import Cable
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.terms.assembly import Assembly, Compiler, HistoryVariables
from gossamer_fx.mechanics.terms.coordinates import Coordinates
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule
from gossamer_fx.mechanics.terms.element_energies import (
    ElementEnergies,
    ViscousDissipation,
    ViscousForces,
    quadrature_element,
)


@check_arguments
@dataclass(frozen=True, eq=False)
class Viscoelasticity(OnBody):
    """Stiffness of a film, cable or beam that relaxes: C(t) = C (1 + Σ r_k exp(-t/τ_k)), with the
    stiffness C of its law.  The loss counts as dissipated, the energy of the branches as stored.

    A standard linear solid has one branch.  Of a Prony series with shares g_k of the instantaneous
    modulus E0 give the law the modulus E0 (1 - Σ g_k), and r_k = g_k/(1 - Σ g_k).  The branches are
    relaxed at the start of a run, and in an `Equilibrium`.

    Args:
        body: a film, cable or beam whose law is quadratic in the strain, e.g. `Linear`.
        ratios: r_k, stiffness of each branch over that of the law.
        times: τ_k [s] of each branch.
        name: name in messages and output.

    Raises:
        InputError: no branch, other numbers of ratios and times, one of them that is not positive;
            a law that wrinkles or goes slack, a plate, a body with thermal expansion.

    Example:
        >>> polymer = gx.Linear(1e9, 0.4, density=930.0, thickness=38e-6)
        >>> film = gx.Membrane(mesh, polymer)
        >>> gx.loads.Viscoelasticity(film, ratios=(0.5, 0.2), times=(1.0, 60.0)).name
        'viscoelasticity'
    """

    body: Membrane | Cable | Beam
    _: KW_ONLY
    ratios: Sequence[Annotated[float, positive()]]
    times: Sequence[Annotated[float, positive("s")]]
    name: str = "viscoelasticity"

    def __post_init__(self) -> None:
        what = f"Viscoelasticity '{self.name}'"
        check(
            len(self.ratios) == len(self.times) > 0,
            f"{what}: {len(self.ratios)} ratios and {len(self.times)} times are given; "
            "give one of each for every branch.",
        )
        body = self.body
        check(
            not body.bends,
            f"{what}: '{body.name}' is a Plate, whose bending does not relax here; "
            "use a Membrane, Cable or Beam.",
        )
        check(
            body.thermal is None,
            f"{what}: '{body.name}' has thermal expansion; leave one of them out.",
        )
        check(
            isinstance(body, Beam) or body.law.quadratic,
            f"{what}: the law of '{body.name}' is not quadratic in the strain; "
            "use one that is, such as Linear or a CableLaw of Green strain.",
        )

    def terms(self, start: State) -> Iterable[Term]:
        body = self.body
        yield RelaxingEnergy(
            self.name,
            body,
            body.measure,
            body.density,
            body.dx,
            discrete_derivative=body.discrete_derivative,
            ratios=tuple(self.ratios),
            times=tuple(self.times),
        )


class RelaxingEnergies(ElementEnergies, HistoryVariables):
    """All `RelaxingEnergy` terms of a scene; at rest they have no stress."""

    def __init__(self, terms: Sequence[RelaxingEnergy], system: Assembly) -> None:
        self._relaxing: list[RelaxingForces] = []
        super().__init__([] if system.rule.is_static else terms, system)

    def _viscous_forces(
        self, term: ViscousDissipation, at: Coordinates, rule: StressRule
    ) -> ViscousForces:
        assert isinstance(term, RelaxingEnergy)
        forces = RelaxingForces(term, at, rule)
        self._relaxing.append(forces)
        return forces

    def begin_step(self, t: float) -> None:
        super().begin_step(t)
        for forces in self._relaxing:
            forces.begin_step(self._system.h)

    def take_time(self, t: float) -> None:
        # A state is restored: what is committed next is not the end of a step.
        for forces in self._relaxing:
            forces.in_step = False

    def commit(self) -> None:
        for forces in self._relaxing:
            forces.commit()

    def energies(self) -> dict[str, float]:
        return {forces.term.name: forces.energy() for forces in self._relaxing}

    def without_gradient(self) -> str:
        for forces in self._relaxing:
            return f"the stress of '{forces.term.name}' depends on its history; leave it out"
        return ""

    def get_history(self) -> dict[str, Any]:
        """Empty: all history is that of cells."""
        return {}

    def shape_history(self) -> dict[str, Any]:
        return self.get_history()

    def set_history(self, state: dict[str, Any]) -> None:
        # The arrays of `cell_history` have been written to.
        for forces in self._relaxing:
            forces.take_history()

    def cell_history(self) -> dict[str, tuple[MeshBody, Array]]:
        """The elastic strains by number of the term, of its branch (or of the mean), and of the row
        in `history`."""
        found = {}
        for i, forces in enumerate(self._relaxing):
            for k, z in enumerate([*forces.history, forces.mean]):
                for j, values in enumerate(z):
                    found[f"elastic strain {i} {k} {j}"] = forces.term.body, values
        return found

    def branches_of(self, body: MeshBody) -> list[RelaxingForces]:
        """Those of a body, whose strains stress fields add."""
        return [forces for forces in self._relaxing if forces.term.body is body]


@dataclass(frozen=True, eq=False)
class RelaxingEnergy(ViscousDissipation):
    """Energies Σ r_k ∫ψ(z_k) dx of Maxwell branches; `density` is ψ, quadratic and convex, as a
    function of the measure; `ratios` are r_k, `times` τ_k [s]."""

    _: KW_ONLY
    ratios: tuple[float, ...]
    times: tuple[float, ...]
    compiler: ClassVar[Compiler] = RelaxingEnergies


class RelaxingForces(ViscousForces):
    """Stresses, loss and history of one `RelaxingEnergy`; numbers of equations are those of the
    module.

    Attributes:
        in_step: whether the next state that is committed is the end of a step.
        history: z_k of each branch, a row for each component at each point of the n cells that
            this rank owns.
        mean: Σ r_k z_k in the mean of the last step, as one of `history`.
    """

    term: RelaxingEnergy

    def __init__(self, term: RelaxingEnergy, at: Coordinates, rule: StressRule) -> None:
        """Make the history, all zero, and compile.  Collective."""
        mesh = at.q1.function_space.mesh
        (size,) = term.measure(at.q1).ufl_shape
        space = fem.functionspace(mesh, quadrature_element(mesh, term.dx.metadata(), (size,)))
        topology = mesh.topology
        # Quadrature points of each owned cell, and z_k of `history` as functions for the forms.
        self._rows = cell_nodes(space)[: topology.index_map(topology.dim).size_local]
        self._z = [fem.Function(space) for _ in term.times]
        # E of each branch in the present step.
        self._decays = [constant(mesh, 1.0) for _ in term.times]
        self._ratios = [constant(mesh, ratio) for ratio in term.ratios]
        count = self._rows.shape[1] * size
        self.history = [np.zeros((count, len(self._rows))) for _ in term.times]
        self.mean = np.zeros((count, len(self._rows)))
        self.in_step = False
        super().__init__(term, at, rule)
        energies = [r * term.density(z) for r, _, z in self._branches()]
        self._energy = compile_form(sum(energies) * term.dx)
        self._strain = fem.Function(space)
        self._strain_at_start: Array = self._strain.x.array.copy()
        points = interpolation_points(space)
        self._set_strain: Callable[[], None] = tabulation(
            compile_expression(term.measure(at.q1), points), self._strain
        )

    def _branches(self) -> Iterable[tuple[fem.Constant, fem.Constant, fem.Function]]:
        """r, E and z0 of each branch."""
        return zip(self._ratios, self._decays, self._z, strict=True)

    def _stress(self, change: Expr) -> Expr:
        # Equation (3).
        ψ = self.term.density
        stresses = [(1 + E) / 2 * r * gradient(ψ, z + change / 2) for r, E, z in self._branches()]
        return sum(stresses[1:], stresses[0])

    def _loss(self, change: Expr) -> Expr:
        # Equation (4).
        ψ = self.term.density
        return sum(r * (1 - E**2) * ψ(z + change / 2) for r, E, z in self._branches())

    def begin_step(self, h: float) -> None:
        self.in_step = True
        for E, τ in zip(self._decays, self.term.times, strict=True):
            E.value = math.exp(-h / τ)

    def commit(self) -> None:
        """Take the strain of the accepted state, and at the end of a step z by equation (2)."""
        self._set_strain()
        change = self._strain.x.array - self._strain_at_start
        self._strain_at_start[:] = self._strain.x.array
        if not self.in_step:
            return
        self.in_step = False
        (size,) = self._strain.function_space.value_shape
        # Δe in the order of `history`: a column for each cell.
        in_cells = change.reshape(-1, size)[self._rows].reshape(len(self._rows), -1).T
        self.mean[:] = self._sum() / 2
        for E, z in zip(self._decays, self.history, strict=True):
            decay = float(E.value)
            z *= decay
            z += (1 + decay) / 2 * in_cells
        self.mean += self._sum() / 2
        self.take_history()

    def _sum(self) -> Array:
        """Σ r_k z_k, as one of `history`."""
        parts = [r * z for r, z in zip(self.term.ratios, self.history, strict=True)]
        return np.asarray(sum(parts))

    def shown_strain(self, at_end: bool) -> tuple[fem.Function, Callable[[], None]]:
        """Σ r_k z_k at the end of the last step, or in its mean, as a discontinuous function, and
        what sets it through the values at the quadrature points of each cell."""
        space = self._strain.function_space
        (size,) = space.value_shape
        order = self.term.body.space.ufl_element().degree - 1
        smooth = fem.functionspace(space.mesh, ("Discontinuous Lagrange", order, (size,)))
        function = fem.Function(smooth)
        [shapes] = smooth.ufl_element().sub_elements[0].tabulate(0, interpolation_points(space))
        through_points = np.linalg.pinv(shapes)
        nodes = cell_nodes(smooth)[: len(self._rows)]

        def update() -> None:
            at_points = self._sum() if at_end else self.mean
            values = at_points.T.reshape(len(nodes), -1, size)
            function.x.array.reshape(-1, size)[nodes] = through_points @ values
            function.x.scatter_forward()

        return function, update

    def take_history(self) -> None:
        """Copy the history to the functions of the forms."""
        (size,) = self._strain.function_space.value_shape
        for function, z in zip(self._z, self.history, strict=True):
            function.x.array.reshape(-1, size)[self._rows] = z.T.reshape(*self._rows.shape, size)

    def energy(self) -> float:
        """Stored energy [J] of the branches, this rank's share."""
        return float(fem.assemble_scalar(self._energy))
