"""Energies and dissipation of measures between points, as arrays.

All terms of one kind are evaluated at once.  The rule is that of `discrete_gradient`: the force is
S_mean·De(q_mid) with S_mean·(e1 - e0) = ψ(e1) - ψ(e0), or the loss of the step; a rule that does
not conserve takes the stress of one strain instead.  Measures are evaluated on the rank of their
first port.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.core.algebra.point_measures import (
    Gather,
    PointMeasure,
    PointMeasures,
    add_blocks,
    attach_all,
    evaluated_here,
    nodes_of,
    refuse_ports_outside,
)
from gossamer_fx.core.model.body import Array, Port
from gossamer_fx.core.model.terms import Parameter
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
    HistoryVariables,
)
from gossamer_fx.mechanics.terms.discrete_gradient import PointDensity, StressRule

# Size of complex steps.  They do not cancel, so that the step may be so small that its square is
# below the round-off of any number.
COMPLEX_STEP = 1e-30


class PointDamping(Protocol):
    """Stress against the rate of the m strains of a point measure, never with negative loss."""

    def average(self, e0: Array, e1: Array, h: float) -> tuple[Array, Array]:
        """S_mean (n, m) and dS_mean/de1 (n, m, m) in a step of h seconds.

        The loss S_mean·(e1 - e0) [J] is never negative.
        """


@runtime_checkable
class BoundedDensity(PointDensity, Protocol):
    """A `PointDensity` of strains within a range, beyond which its stress would jump."""

    range: str  # in words, e.g. "half a turn"

    def leaves_range(self, e0: Array, e1: Array) -> npt.NDArray[np.bool_]:
        """Whether a step from the strains e0 to e1 (n, m) leaves the range, (n,)."""


class PathDensity(HistoryVariables):
    """A `PointDensity` whose stress depends on the strains of the past, and which dissipates.

    In a step S_mean·(e1 - e0) = Δψ + the loss, with the history at the start of the step.
    """

    @abstractmethod
    def take(self, e: Array) -> None:
        """Add accepted strains (n, m) to the history, from which the next step starts."""

    @abstractmethod
    def loss(self, e0: Array, e1: Array) -> Array:
        """Dissipated energies [J] (n,) between two strains (n, m), of which either may be beyond
        the history."""


class Stencil:
    """Measures of one kind with one density, a `PointDamping` if it `dissipates`: their forces,
    tangents and energies, with forces at q_mid = (1 - α) q0 + α q1.

    In the methods q1 (n, D) are the unknowns of n tuples of ports at the end of the step, positions
    [m] and directors [-].  A result is reused for the same array object: it must not be changed in
    place.  With pairs that change from step to step, a new stencil is made for each list of them.
    Damping takes the strains at both ends with every stress rule.
    """

    def __init__(self, at: PointMeasures, density: Any, dissipates: bool, rule: StressRule) -> None:
        """The start of a step is set by `keep`, its length [s] by the attribute `h`; until then
        they are zero, and 1 s."""
        self.at = at
        self.density = density
        self._dissipates = dissipates
        self._rule = rule
        self._takes_mid_strain = rule.takes_mid_strain and not dissipates
        self.h = 1.0
        # Unknowns q1 (n, D), vectors (n, 3k), strains (n, m) and stresses (n, m) with their
        # derivatives (n, m, m) of the last evaluation, for forces and tangent of one iterate.
        self._known: tuple[Array, Array, Array, tuple[Array, Array]] | None = None
        self.keep(np.zeros((at.n, at.D)))

    def keep(self, q0: Array) -> None:
        """Set the unknowns q0 (n, D) at the start of a step."""
        self._Y0 = self.at.vectors(q0)
        self._known = None
        self.e0 = self.at.measure(self._Y0)

    def force(self, q1: Array) -> Array:
        """Forces S_mean·De(q_mid) (n, D) [N] of a step on the unknowns, with the mean stress
        S_mean.  They are computed where there is stress: slack ropes and open stops cost little."""
        # Y (n, 3k): the vectors of which the strains are made; S (n, m): their mean stresses.
        Y, _, (S, _) = self._end(q1)
        on = _all_or_some(S.any(axis=1))
        slope = self.at.slope(self._middle(Y, on), on)
        forces_on_vectors = S[on][:, None] @ slope
        forces = self.at.forces(forces_on_vectors, on)[:, 0]
        # All rows have stress: nothing is to be scattered.
        if isinstance(on, slice):
            return forces
        found = np.zeros_like(q1)
        found[on] = forces
        return found

    def tangent(self, q1: Array) -> Array:
        """De(q_mid)ᵀ dS_mean/de1 De(q1) + α S_mean·D²e (n, D, D), computed where it is not zero."""
        K, on = self._stiffness(q1)
        if isinstance(on, slice):
            return self.at.stiffness(K)
        found = np.zeros((self.at.n, self.at.D, self.at.D))
        found[on] = self.at.stiffness(K, on)
        return found

    def add_tangent(self, A: PETSc.Mat, q1: Array) -> None:
        """Add the derivatives [N/m] of the forces by q1 to a matrix that is not yet assembled."""
        at = self.at
        if at.share_unknowns:
            # One block is entered instead of n at the same rows.  K (r, 3k, 3k) is the stiffness of
            # the rows `on` that have one.
            K, on = self._stiffness(q1)
            total = at.sum_of_stiffness(K, on)
            add_blocks(A, at.indices[:1], at.indices[:1], total[None])
        else:
            add_blocks(A, at.indices, at.indices, self.tangent(q1))

    def _stiffness(self, q1: Array) -> tuple[Array, Any]:
        """Stiffness (r, 3k, 3k) [N/m]: derivatives of the forces on the k vectors that strains are
        made of by these vectors; and the indices (r,) of the rows that have stress or stiffness, or
        a slice if all have."""
        # Y (n, 3k): the vectors; S (n, m): mean stresses; dS (n, m, m): their derivatives by the
        # strains at the end; α: weight of the end in the configuration where forces act.
        Y, _, (S, dS) = self._end(q1)
        on = _all_or_some(S.any(axis=1) | dS.any(axis=(1, 2)))
        slope_mid = self.at.slope(self._middle(Y, on), on)
        # The slope of the strain of S by the vectors at the end.  Not that of De in S·De(q_mid), so
        # that the tangent is not symmetric, unless the rule takes the strain in the middle.
        slope: Array = self._rule.alpha * slope_mid
        if not self._takes_mid_strain:
            slope = self.at.slope(Y[on], on)
        material = slope_mid.transpose(0, 2, 1) @ (dS[on] @ slope)
        geometric = self._rule.alpha * self.at.geometric(S[on], on)
        return material + geometric, on

    def _middle(self, Y: Array, on: Any) -> Array:
        """Vectors (r, 3k) of the configuration in which forces act, of the rows `on`, from those Y
        (n, 3k) at the end of the step."""
        α = self._rule.alpha
        return (1 - α) * self._Y0[on] + α * Y[on]

    def _end(self, q1: Array) -> tuple[Array, Array, tuple[Array, Array]]:
        """The k vectors (n, 3k) of which the strains are made at q1, the strains (n, m) that the
        rule takes, and the mean stress (n, m) of the step with its derivatives (n, m, m) by
        them."""
        # Y: the vectors, points [m] and directors [-].
        # The same array object, not equal numbers: a comparison would cost as much as it saves.
        if self._known is None or self._known[0] is not q1:
            Y = self.at.vectors(q1)
            of_strain = self._middle(Y, slice(None)) if self._takes_mid_strain else Y
            e1 = self.at.measure(of_strain)
            self._known = q1, Y, e1, self._average(e1)
        return self._known[1:]

    def stresses(self, q1: Array) -> tuple[Array, Array]:
        """Mean stresses (n, m) of a step, and the measures (n, m) of the configuration in which
        they act."""
        Y, _, (S, _) = self._end(q1)
        return S, self.at.measure(self._middle(Y, slice(None)))

    def _average(self, e1: Array) -> tuple[Array, Array]:
        """Stress S_mean (n, m) of a step to the strain e1 (n, m), and dS_mean/de1 (n, m, m)."""
        if self._dissipates:
            return self.density.average(self.e0, e1, self.h)
        return self._rule.point_stress(self.density, self.e0, e1)

    def energy(self) -> Array:
        """ψ (n,) at the start of the step."""
        if self._dissipates:
            return np.zeros(self.at.n)
        return self.density.energy(self.e0)

    def force_by_number(self, q1: Array, key: str) -> Array:
        """Derivatives (n, D) of the forces [N] of a step by a number of the density, named by its
        attribute, e.g. "k", by a complex step: laws are analytic in their numbers where they are
        smooth, so that nothing cancels."""
        # Y (n, 3k): vectors, and e1 (n, m): strains at the end; S: the complex mean stress.
        Y, e1, _ = self._end(q1)
        density = self.density
        self.density = self._varied(key, 1j * COMPLEX_STEP)
        # The stencil is whole again even if the density refuses a complex number.
        try:
            S, _ = self._average(e1)
        finally:
            self.density = density
        dS: Array = S.imag / COMPLEX_STEP
        forces: Array = self.at.forces(dS[:, None] @ self.at.slope(self._middle(Y, slice(None))))
        return forces[:, 0]

    def energy_by_number(self, q1: Array, key: str) -> Array:
        """∂ψ/∂number (n,) at the end of the step."""
        if self._dissipates:
            return np.zeros(self.at.n)
        e1 = self.at.measure(self.at.vectors(q1))
        return self._varied(key, 1j * COMPLEX_STEP).energy(e1).imag / COMPLEX_STEP

    def set_number(self, key: str, value: float, at: Array) -> None:
        """Give a number of the density a value at some tuples of ports, of which `at` (n,) is
        true."""
        values = np.broadcast_to(getattr(self.density, key), at.shape)
        values = np.where(at, value, values)
        self.density = replace(self.density, **{key: values})
        self._known = None

    def _varied(self, key: str, change: complex) -> Any:
        """The density with one number changed everywhere."""
        return replace(self.density, **{key: getattr(self.density, key) + change})

    def leaves_range(self, q1: Array) -> npt.NDArray[np.bool_]:
        """Whether each row of a measure with a `BoundedDensity` leaves its range in the step,
        (n,)."""
        e1 = self.at.measure(self.at.vectors(q1))
        return self.density.leaves_range(self.e0, e1)

    def loss(self, q1: Array) -> Array:
        """Dissipated energy of each row of the measure (n,) in the step [J]."""
        if isinstance(self.density, PathDensity):
            return self.density.loss(self.e0, self.at.measure(self.at.vectors(q1)))
        _, e1, (S, _) = self._end(q1)
        return np.einsum("nm,nm->n", S, e1 - self.e0)


def _all_or_some(on: Any) -> Any:
    """Indices where it is true (n,); a slice, which copies nothing, where it is true everywhere."""
    if on.all():
        return slice(None)
    return np.flatnonzero(on)


class BetweenPoints(ABC):
    """Facet of compiled terms whose forces act between points."""

    @abstractmethod
    def stresses_of_step(self, term: Any) -> Array:
        """Mean stresses (r, m) of a term in the last accepted step, of the r tuples of ports that
        this rank evaluates (`point_measures.evaluated_here`).  Collective."""


class PointEnergies(
    BetweenPoints, Differentiable, CompiledTerms["PointStoredEnergy | PointDissipation"]
):
    """All `PointStoredEnergy` and `PointDissipation` terms of a scene."""

    has_shape_derivative = True

    def __init__(
        self, terms: Sequence[PointStoredEnergy | PointDissipation], system: Assembly
    ) -> None:
        """Compile all energies and dampers between points, in the same order on all ranks; those of
        one kind, such as all springs, are one array.  Collective."""
        tuples = [(term.name, term.measure.ports) for term in terms]
        refuse_ports_outside(system.comm, system.bodies, tuples)
        self._system = system
        # Of the stored energies.
        self._names = [term.name for term in terms if isinstance(term, PointStoredEnergy)]
        # Terms of one kind become arrays: a thousand ropes cost little more than one.
        groups: dict[Any, list[PointStoredEnergy | PointDissipation]] = {}
        for term in terms:
            groups.setdefault(_kind(term), []).append(term)
        self._groups = []
        for alike in groups.values():
            at = PointMeasures(system.numbering, system.bodies, [term.measure for term in alike])
            density = _stacked([term.density for term in alike], at.owner)
            dissipates = isinstance(alike[0], PointDissipation)
            stencil = Stencil(at, density, dissipates=dissipates, rule=system.rule)
            self._groups.append((alike, stencil))
        self._stencils = [stencil for _, stencil in self._groups]
        # Names of the dampers in the order of the groups, in which `dissipated` returns their
        # losses; `_names` (stored energies) is in the order of `terms`.
        self.losses = []
        for alike, _ in self._groups:
            self.losses += [term.name for term in alike if isinstance(term, PointDissipation)]
        self._gather = Gather(system.numbering, [stencil.at.indices for stencil in self._stencils])
        # Unknowns of the stencils in q1, fetched once in an iteration.
        self._ends: list[Array] | None = None
        # Names of the stencils whose density has a history, by index; each has one term, whose loss
        # follows those of the dampers.
        self._with_history: dict[int, str] = {}
        for k, (alike, stencil) in enumerate(self._groups):
            if isinstance(stencil.density, PathDensity):
                self._with_history[k] = alike[0].name
        self.losses += self._with_history.values()
        # Indices of the stencils whose density has a range, the same on all ranks.
        self._bounded: list[int] = []
        for k, stencil in enumerate(self._stencils):
            if isinstance(stencil.density, BoundedDensity):
                self._bounded.append(k)
        # New values of numbers of laws, such as a stiffness, that `set_number` changed after the
        # compilation, by the identity of the term and the name of the number.
        self._numbers: dict[tuple[int, str], float] = {}

    def begin_search(self) -> None:
        """Take the accepted state into the histories of densities that have one."""
        for k in self._with_history:
            self._stencils[k].density.take(self._stencils[k].e0)

    def begin_step(self, t: float) -> None:
        """Start a step of length `system.h` [s]."""
        self._ends = None
        # In statics histories change at the start of a search only, not in its pseudo-steps.
        if not self._system.rule.is_static:
            self.begin_search()
        for stencil in self._stencils:
            stencil.h = self._system.h

    def update(self, linearly: bool) -> None:
        """Forget the unknowns of the last iterate."""
        self._ends = None

    def inadmissible(self) -> str:
        """A sentence on the first term, by its name, that leaves the range of its density in this
        step.  Collective."""
        if not self._bounded:
            return ""
        ends = self._at_end()
        problems = []
        for k in self._bounded:
            terms, stencil = self._groups[k]
            for i in stencil.at.owner[stencil.leaves_range(ends[k])]:
                problems.append(
                    f"'{terms[i].name}' passes {stencil.density.range}, beyond which its moment "
                    "would jump"
                )
        first_here = min(problems, default="")
        return min(filter(None, self._system.comm.allgather(first_here)), default="")

    def _at_end(self) -> list[Array]:
        """Unknowns (n, D) of each stencil at the end of the step.  Collective."""
        if self._ends is None:
            self._ends = self._gather(self._system.q1)
        return self._ends

    def commit(self) -> None:
        """Make the accepted coordinates those at the start of the next step."""
        for stencil, q in zip(self._stencils, self._gather(self._system.q0), strict=True):
            stencil.keep(q)

    def add_forces(self, r: PETSc.Vec) -> None:
        """Add the forces [N] of all terms to r."""
        for stencil, q in zip(self._stencils, self._at_end(), strict=True):
            indices = stencil.at.indices.ravel()
            forces = stencil.force(q).ravel()
            r.setValues(indices, forces, addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the tangents [N/m] of all terms to A."""
        for stencil, q in zip(self._stencils, self._at_end(), strict=True):
            stencil.add_tangent(A, q)

    def energies(self) -> dict[str, float]:
        """This rank's share of the stored energy [J] at the start of the step, by name."""
        found = dict.fromkeys(self._names, 0.0)
        for terms, stencil in self._groups:
            if isinstance(terms[0], PointStoredEnergy):
                shares = np.bincount(stencil.at.owner, stencil.energy(), len(terms))
                for term, share in zip(terms, shares, strict=True):
                    found[term.name] += float(share)
        return found

    def stresses(
        self, term: PointStoredEnergy, rule: StressRule, *, at_start: bool = False
    ) -> tuple[Array, Array]:
        """Measures (r, m) and stresses (r, m) of a term in the last accepted step by a rule, or at
        its start, of the r tuples of ports that this rank evaluates
        (`point_measures.evaluated_here`).  The measures are those of the configuration in which the
        stresses act.  Collective."""
        of_step, rows, k = self._last_step(term, rule)
        end = self._system.previous if at_start else self._system.q0
        stresses, measures = of_step.stresses(self._gather(end)[k])
        return measures[rows], stresses[rows]

    def stresses_of_step(self, term: PointStoredEnergy | PointDissipation) -> Array:
        of_step, rows, k = self._last_step(term, self._system.rule)
        stresses, _ = of_step.stresses(self._gather(self._system.q0)[k])
        # A damper has no force at rest, whatever the last pseudo-step of the search was.
        if isinstance(term, PointDissipation) and self._system.rule.is_static:
            stresses = np.zeros_like(stresses)
        return stresses[rows]

    def _last_step(
        self, term: PointStoredEnergy | PointDissipation, rule: StressRule
    ) -> tuple[Stencil, npt.NDArray[np.bool_], int]:
        """The stencil with a term at the start of the last accepted step, which of its rows are
        those of the term, and its index.  Collective."""
        stencil, i = self._find(term)
        k = self._stencils.index(stencil)
        dissipates = isinstance(term, PointDissipation)
        of_step = Stencil(stencil.at, stencil.density, dissipates=dissipates, rule=rule)
        # Not the length of a step that is tried; after a restart that is not known.
        of_step.h = (self._system.time - self._system.previous_time) or self._system.h
        of_step.keep(self._gather(self._system.previous)[k])
        return of_step, stencil.at.owner == i, k

    # ---- sensitivities ---------------------------------------------------------------------------

    def get_number(self, term: PointStoredEnergy | PointDissipation, key: str) -> Array:
        """Present value (1,) of the number `key` of a term's density."""
        given = getattr(term.density, key)
        return np.atleast_1d(self._numbers.get((id(term), key), given))

    def set_number(
        self, term: PointStoredEnergy | PointDissipation, key: str, value: Array
    ) -> None:
        """Change the number `key` of a term's density to `value` (1,)."""
        stencil, i = self._find(term)
        self._numbers[id(term), key] = float(value[0])
        stencil.set_number(key, float(value[0]), stencil.at.owner == i)

    def work_by_number(
        self, term: PointStoredEnergy | PointDissipation, key: str, w: PETSc.Vec
    ) -> Array:
        """Derivative (1,) of w·forces by the number `key`, this rank's share."""
        stencil, i = self._find(term)
        k = self._stencils.index(stencil)
        forces = stencil.force_by_number(self._at_end()[k], key)
        work = np.sum(forces * self._gather(w)[k], axis=1)
        return np.array([work[stencil.at.owner == i].sum()])

    def energy_by_number(self, term: PointStoredEnergy | PointDissipation, key: str) -> Array:
        """Derivative (1,) of the stored energy by the number `key`, this rank's share."""
        stencil, i = self._find(term)
        k = self._stencils.index(stencil)
        energies = stencil.energy_by_number(self._at_end()[k], key)
        return np.array([energies[stencil.at.owner == i].sum()])

    def _find(self, term: PointStoredEnergy | PointDissipation) -> tuple[Stencil, int]:
        """The stencil of a term, and the number of the term in it."""
        for terms, stencil in self._groups:
            for i, one in enumerate(terms):
                if one is term:
                    return stencil, i
        raise ValueError(f"'{term.name}' is not in this scene")

    def dissipated(self) -> Array:
        """Energy [J] that each term of `losses` dissipates on this rank in the step."""
        found: list[float] = []
        for (terms, stencil), q in zip(self._groups, self._at_end(), strict=True):
            if isinstance(terms[0], PointDissipation):
                loss = stencil.loss(q)
                # A damper loses a power, which no pseudo-time multiplies in a search for rest; what
                # yields below loses the same, however slowly.
                if self._system.rule.is_static:
                    loss = np.zeros_like(loss)
                found.extend(np.bincount(stencil.at.owner, loss, len(terms)))
        found += [self._stencils[k].loss(self._at_end()[k]).sum() for k in self._with_history]
        return np.array(found)

    def without_gradient(self) -> str:
        """A sentence on the first density with a history, whose derivative is not known; else an
        empty one."""
        for name in self._with_history.values():
            return (
                f"'{name}' unloads on another curve than it is loaded, so that its force depends "
                "on the path; give it a law without unloading"
            )
        return ""


@dataclass(frozen=True, eq=False)
class PointStoredEnergy:
    """Stored energy ψ(e) of a point measure."""

    name: str
    measure: PointMeasure
    density: PointDensity
    parameters: tuple[Parameter, ...] = ()
    compiler: ClassVar[Compiler] = PointEnergies


@dataclass(frozen=True, eq=False)
class PointDissipation:
    """Dissipation by the rate of a point measure."""

    name: str
    measure: PointMeasure
    density: PointDamping
    parameters: tuple[Parameter, ...] = ()
    compiler: ClassVar[Compiler] = PointEnergies


def _kind(term: PointStoredEnergy | PointDissipation) -> Any:
    """Hashable key of the energies and dampers that are evaluated as one array: the class of the
    term and of its density, the numbers of the density except those named in its `stacks`, which
    may be arrays, and the shapes of the measure.  A density without `stacks` has a key of its term
    alone."""
    density = term.density
    stacks = getattr(density, "stacks", None)
    # A density that cannot be stacked is an array of one term.
    if stacks is None:
        return id(term)
    others = []
    for name, value in sorted(vars(density).items()):
        if name not in stacks:
            others.append((name, value))
    shape = term.measure.H.shape
    return type(term), type(density), tuple(others), shape, nodes_of(term.measure)


def _stacked(densities: Sequence[Any], of: Array) -> Any:
    """One density for all rows of an array, with arrays (n,) of the numbers that differ; `of` (n,)
    is the index of the density to which each row belongs."""
    first = densities[0]
    if len(densities) == 1:
        return first
    stacked = {}
    for name in first.stacks:
        numbers = np.array([getattr(density, name) for density in densities])
        stacked[name] = numbers[of]
    return replace(first, **stacked)


def one_sided_energy(y: Array) -> Array:
    """ψ(y) = ½ max(y, 0)², of any shape."""
    return np.maximum(y, 0.0) ** 2 / 2


def one_sided_average(y0: Array, y1: Array) -> tuple[Array, Array]:
    """Average T_mean of T(y) = max(y, 0) along the straight path from y0 to y1, arrays of one shape
    in any unit, and its derivative by y1.

    The average is exact, also where the path passes zero: T_mean (y1 - y0) = ψ(y1) - ψ(y0) with ψ =
    ½ max(y, 0)², so a step with it conserves energy.  It does not divide by a small change: that is
    done only where the path passes zero, and there |y1 - y0| >= |y1|.
    """
    pull0 = np.maximum(y0, 0.0)
    pull1 = np.maximum(y1, 0.0)
    passes_zero = (y0 > 0) != (y1 > 0)
    # Elsewhere the divisor is 1: its quotient is not read, and must not divide by zero.
    change = np.where(passes_zero, y1 - y0, 1.0)
    quotient = (pull1**2 - pull0**2) / (2 * change)
    slope_of_quotient = (pull1 - quotient) / change
    # Where T is linear all the way, the trapezoidal rule is exact.
    trapezoidal_mean = (pull0 + pull1) / 2
    trapezoidal_slope = np.where(y1 > 0, 0.5, 0.0)
    mean = np.where(passes_zero, quotient, trapezoidal_mean)
    slope = np.where(passes_zero, slope_of_quotient, trapezoidal_slope)
    return mean, slope


# ---- kinetic energy of attached vectors ----------------------------------------------------------


class AttachedMasses(Differentiable, CompiledTerms["AttachedKineticEnergy"]):
    """All `AttachedKineticEnergy` terms of a scene."""

    forces_are_forms = True
    has_shape_derivative = True

    def __init__(self, terms: Sequence[AttachedKineticEnergy], system: Assembly) -> None:
        self._terms = terms
        self._system = system

    def add_mass(self, M: PETSc.Mat) -> None:
        self._add(M, np.eye(3))

    def add_gyroscopic(self, G: PETSc.Mat, spin: tuple[float, float, float]) -> None:
        """Add the matrix 2 w·M (spin × v) of a frame that turns with `spin` (3,) [rad/s] to G."""
        cross = np.cross(np.eye(3), np.asarray(spin))
        self._add(G, 2 * cross)

    def _add(self, matrix: PETSc.Mat, each: Array) -> None:
        """Add Σ_ij mass[i, j] w_i·(each v_j) of all terms to a matrix, v and w rates of attached
        vectors; `each` (3, 3) is the unit matrix for masses, or twice the matrix of a cross product
        with an angular velocity [rad/s] for the Coriolis force."""
        for term in self._terms:
            # Each tuple is added on one rank; the matrix adds up what ranks share.  The attached
            # vectors are P q (n tuples) of unknowns q.
            own = evaluated_here(term.ports)
            n = len(own)
            rows = 3 * term.mass.shape[1]
            tuples = [term.ports[i] for i in own]
            # Offsets of the ground are not needed: it has no velocity.
            indices, P, _ = attach_all(
                numbering=self._system.numbering,
                bodies=self._system.bodies,
                tuples=tuples,
                rows=rows,
            )
            of_vectors = np.einsum("nij,ab->niajb", term.mass[own], each)
            mass = of_vectors.reshape(n, rows, rows)
            of_unknowns = np.einsum("nax,nab,nby->nxy", P, mass, P, optimize=True)
            add_blocks(matrix, indices, indices, of_unknowns)


@dataclass(frozen=True, eq=False)
class AttachedKineticEnergy:
    """Kinetic energy ½ Σ_ij mass[i, j] v_i·v_j of the rates v of attached vectors.

    Args:
        ports: n tuples of k ports, as those of a `PointMeasure`.
        mass: (n, k, k) [kg] for points; kg m and kg m² where directors take part.
    """

    ports: Sequence[tuple[Port, ...]]
    mass: Array
    compiler: ClassVar[Compiler] = AttachedMasses
