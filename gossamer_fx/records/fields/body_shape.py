"""The shape of a body on a mesh, as functions of which expressions are made, and its stress.

A time step that conserves energy damps nothing: what it does not resolve oscillates from step to
step.  Stresses at the ends of steps alternate then, and so do the states of films.  The stress that
a step *used*, the mean along its path of strains (`terms.discrete_gradient`), does not, and its
work is that of the energy balance.  Stresses, tensions, moments and states of films are therefore
means over the last accepted step, unless they are asked for `at="end"`.  The stress rule says what
the mean is: of rules that take the stress at the end of a step, or in its middle, it is that one,
and so it is in statics.

All of them follow from the coordinates at both ends of the last step, which checkpoints contain,
and of bodies that relax or have internal friction from the strains of their branches.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Literal
from weakref import WeakSet

import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_constants

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.compilation import constant
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.strain_path import energy_gradient
from gossamer_fx.core.model.body import MeshBody
from gossamer_fx.core.model.state import State
from gossamer_fx.mechanics.terms.discrete_gradient import EndPoint, StressRule
from gossamer_fx.mechanics.terms.element_energies import (
    ElementEnergies,
    StoredEnergy,
    thermal_strain_of,
)
from gossamer_fx.solve.system.system import System

if TYPE_CHECKING:
    from gossamer_fx.mechanics.bodies.thermal_expansion import ThermalCurvature

LOG = logging.getLogger("gossamer_fx")

# The ends of steps alternate if more than this share of the area of a film, or of the ropes of a
# connector, is taut at one end of a step only, in so many records in a row.  A front that moves
# through a film changes less.
ALTERNATING_SHARE = 0.5
ALTERNATING_RECORDS = 3

# Films and connectors for which the warning was logged.
_warned: WeakSet[Any] = WeakSet()

# Stresses and what follows from them: the mean over the last step, or the value at its end.
At = Literal["mean", "end"]

# Points of the path of a step, in the middles of equal parts, for laws that do not give the pieces
# of the path.  Where the state changes on it, shares of the path are right to half of a part.
PATH_POINTS = tuple((k + 0.5) / 20 for k in range(20))


def _branches_of(body: MeshBody, system: System) -> list[Any]:
    """The branches of a body that relaxes or has internal friction, in a compiled scene."""
    kinds = system.equations.compiled_as(ElementEnergies)
    return [branch for compiled in kinds for branch in compiled.branches_of(body)]


def has_unknown_stress(body: MeshBody, system: System) -> bool:
    """Whether the stress of a body is not known: that of a reduced film that relaxes, whose
    branches have strains in the sampled cells only."""
    return body.full is not body and bool(_branches_of(body, system))


def rule_at(at: At, system: System) -> StressRule:
    """The rule by which stresses follow from the last step: that of the run, or its end."""
    return system.unknowns.rule if at == "mean" else EndPoint()


class BodyShape:
    """Coordinates q and velocities v of a body as functions on its mesh.

    The functions are created once; `update` sets them to the values of the state.  A reduced film
    has no nodal unknowns: then the functions are on the mesh of the film that was reduced.

    Args:
        at: when stresses are taken, see the module.

    Attributes:
        body: the body whose mesh, law and measures belong to the functions: of a reduced film the
            film that was reduced, else the body itself.
        q: coordinates: positions [m] and, of a beam, directors.
        q_acting: coordinates in which the forces of the stress act: q, or those in the middle of
            the last step.
        v: their rates.
        rule: by which stresses follow from the last step.
        thermal_strain: thermal strain at q, an expression; None without thermal expansion.
        thermal_curvature: of a plate with a gradient of temperature, an expression; else None.
    """

    def __init__(self, system: System, body: MeshBody, at: At = "end") -> None:
        self._system = system
        self.rule = rule_at(at, system)
        self._state = system.unknowns.state[body]
        # Converts unknowns of the body to those of the mesh; of a reduced film they differ.
        self._reconstruct = body.reconstruct
        self._given_body = body
        self.body: Any = body.full
        # Positions q [m] and velocities v [m/s] of the body
        self.q = fem.Function(self.body.space)
        self.v = fem.Function(self.body.space)
        self.q_acting: Expr = self.q
        # Coordinates at the start of the last step
        self.q_start: fem.Function | None = None
        if not self.rule.acts_at_end:
            self.q_start = fem.Function(self.body.space)
            α = self.rule.alpha
            self.q_acting = (1 - α) * self.q_start + α * self.q
            self._before = State(
                system.unknowns.bodies, system.comm, system.unknowns.previous, system.unknowns.v0
            )[body]
        # Of a law in C, and a reduced film: where on the path its stress is taken, from 0 to 1.
        self._on_path: fem.Constant | None = None
        self._expansion = thermal_strain_of(system.unknowns, body)
        self.thermal_strain: Expr | None = None
        self.thermal_curvature: Expr | None = None
        self._curvature: ThermalCurvature | None = None
        if getattr(self.body, "thermal", None) is not None:
            self._add_expansion()
        # The branches of a body that relaxes or has internal friction
        self._relaxing = _branches_of(body, system)
        # Stresses that they add where a stress is shown, and what sets them
        self._branches: list[tuple[fem.Function, Callable[[], None]]] = []

    def _add_expansion(self) -> None:
        """Set the thermal strain of the body, if the scene has one, and make its thermal curvature.

        Both are UFL expressions: the strain [-], and the curvature [1/m] of a plate whose sides
        have different temperatures.
        """
        # Imported here: bodies without thermal expansion do not load it.
        from gossamer_fx.mechanics.bodies.thermal_expansion import thermal_curvature

        if self._expansion is not None:
            self.thermal_strain = self._expansion.start
        if getattr(self.body, "has_thermal_curvature", False):
            self._curvature = thermal_curvature(self.body)
            self.thermal_curvature = self._curvature.curvature

    def elastic_strain(self) -> Expr:
        """The measure of the body less its thermal strain, of which stresses are functions."""
        e = self.body.measure(self.q)
        if self.thermal_strain is not None:
            e -= self.thermal_strain
        return e

    def strain_path(self) -> tuple[Expr, Expr]:
        """The elastic strains at both ends of the path along which the stress of the last step is
        averaged.  They are one object where the step takes the stress of one strain."""
        e1 = self.elastic_strain()
        if self.q_start is None:
            return e1, e1
        e0 = self.body.measure(self.q_start)
        middle = self.body.measure(self.q_acting)
        if self._expansion is not None:
            e0 -= self._expansion.before
            middle -= (self._expansion.before + self._expansion.start) / 2
        if self.rule.takes_mid_strain:
            return middle, middle
        return e0, e1

    def stress(self) -> Expr:
        """Stress ∂ψ/∂e of the body, as the step used it; of a law in C to be summed over
        `path_points`."""
        e0, e1 = self.strain_path()
        body = self._given_body
        check(
            not has_unknown_stress(body, self._system),
            f"'{body.name}': the stress of a film that is reduced and relaxes is not known in all "
            "its cells; ask for other fields, e.g. displacement and strain1.",
        )
        if not self._branches:
            at_end = self.rule.acts_at_end
            self._branches = [branch.shown_stress(at_end) for branch in self._relaxing]
        stress = self._elastic_stress(e0, e1)
        for of_branches, _ in self._branches:
            stress += of_branches
        return stress

    def _elastic_stress(self, e0: Expr, e1: Expr) -> Expr:
        """Stress of the law on the path of strains from e0 to e1, without that of branches."""
        if e0 is e1:
            return energy_gradient(self.body.density, e1)
        energy = next(
            term
            for term in self._system.unknowns.terms
            if isinstance(term, StoredEnergy) and term.body is self._given_body
        )
        if energy.c_law is not None or self.body is not self._given_body:
            # Of a law in C one stress is a long expression in UFL, many are too long to compile.
            # The energy of a reduced film has the law on another mesh.
            if self._on_path is None:
                self._on_path = constant(self.body.space.mesh, 0.0)
            return energy_gradient(self.body.density, e0 + self._on_path * (e1 - e0))
        return self.rule.stress(energy, e0, ufl.variable(e1))

    def is_on_path(self, expression: Expr) -> bool:
        """Whether an expression is to be summed over `path_points`: those with stresses of laws in
        C, and of reduced films."""
        return self._on_path is not None and self._on_path in extract_constants(expression)

    def path_points(self) -> Iterator[float]:
        """Move the stress to each point of the path in turn, and yield the weight of the point."""
        assert self._on_path is not None
        for point in PATH_POINTS:
            self._on_path.value = point
            yield 1 / len(PATH_POINTS)

    def update(self) -> None:
        """Set the functions to the current values of the state, ghosts included.  Collective."""
        # A state is the accepted one: forms of the bodies read the iterate, and are not used here.
        self._reconstruct(self.q, self._state.coordinates().ravel())
        self._reconstruct(self.v, self._state.rates().ravel())
        if self.q_start is not None:
            self._reconstruct(self.q_start, self._before.coordinates().ravel())
        for _, set_stress in self._branches:
            set_stress()
        if self._curvature is not None:
            self._set_curvature(self._curvature)

    def _set_curvature(self, thermal: ThermalCurvature) -> None:
        """Set the difference of temperature across a plate to that of which the moments of the last
        step were: the one in its middle, unless they are those at the end.  Collective."""
        system = self._system
        difference = thermal.difference
        thermal.set(difference, system.unknowns.time)
        if self.q_start is not None:
            at_end = difference.x.array.copy()
            thermal.set(difference, system.unknowns.previous_time)
            α = self.rule.alpha
            difference.x.array[:] = (1 - α) * difference.x.array + α * at_end


class AlternationWatch:
    """Warns once of a film or connector that is taut at one end of a step only, again and again.

    Args:
        part: the film or connector.
        share_of_it: what a share is of, e.g. "of its area is".
    """

    def __init__(self, part: Any, share_of_it: str) -> None:
        self._part = part
        self._share_of_it = share_of_it
        self._records = 0  # in a row with more than `ALTERNATING_SHARE`
        self._last_time = -math.inf

    def see(self, system: System, share: float) -> None:
        """Record the share that is taut at one end of the last step only, the same on every rank;
        once for each time."""
        if system.unknowns.time == self._last_time:
            return
        self._last_time = system.unknowns.time
        self._records = self._records + 1 if share > ALTERNATING_SHARE else 0
        if self._records < ALTERNATING_RECORDS or self._part in _warned:
            return
        _warned.add(self._part)
        if system.comm.rank == 0:
            LOG.warning(
                "'%s': more than %.0f %% %s taut at one end of a step only, in %d records in a row "
                "until t = %.6g s: the step of %.3g s does not resolve the motion, and damping "
                "does not end it.  Means over steps, recorded unless at='end', do not alternate; a "
                "shorter step, or Damping with a stiffness_factor near the step (of ropes their "
                "damping), removes the oscillation.",
                self._part.name,
                100 * ALTERNATING_SHARE,
                self._share_of_it,
                self._records,
                system.unknowns.time,
                system.unknowns.h,
            )
