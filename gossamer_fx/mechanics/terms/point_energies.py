"""Energies and dissipation of measures between points, as arrays.

All terms of one kind are evaluated at once.  The rule is that of `discrete_gradient`: the force is
S_mean·De(q_mid) with S_mean·(e1 - e0) = ψ(e1) - ψ(e0), or the loss of the step.  With α = 1 the
forces are those of the end of the step, S_mean = ψ'(e1).  Measures are evaluated on the rank of
their first port.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Protocol

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.algebra.point_measures import (
    Gather,
    PointMeasure,
    PointMeasures,
    add_blocks,
    nodes_of,
    refuse_ports_outside,
)
from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.parameters import Parameter
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
)

# Size of complex steps.  They do not cancel, so that the step may be so small that its square is
# below the round-off of any number.
COMPLEX_STEP = 1e-30


class PointDensity(Protocol):
    """Energy of the m strains e of a point measure.

    All arguments and results are arrays over n tuples of ports.  A density whose numbers named in
    `stacks` may also be arrays (n,) shares one evaluation with others of its class.
    """

    def energy(self, e: Array) -> Array:
        """ψ(e) [J], (n,) of (n, m)."""
        ...

    def average(self, e0: Array, e1: Array) -> tuple[Array, Array]:
        """S_mean (n, m) with S_mean·(e1 - e0) = ψ(e1) - ψ(e0), and dS_mean/de1 (n, m, m).

        At e0 = e1 they are ψ' and ψ''/2.
        """
        ...


class PointDamping(Protocol):
    """Stress against the rate of the m strains of a point measure, never with negative loss."""

    def average(self, e0: Array, e1: Array, h: float) -> tuple[Array, Array]:
        """S_mean (n, m) and dS_mean/de1 (n, m, m) in a step of h seconds.

        The loss S_mean·(e1 - e0) [J] is never negative.
        """
        ...


class Stencil:
    """Measures of one kind with one density: their forces, tangents and energies.

    With pairs that change from step to step, a new one is made for each list of them.

    Args:
        at: the measures.
        density: `PointDensity` or `PointDamping` of all of them.
        dissipates: whether it is a `PointDamping`.
        alpha: the forces act at q_mid = (1 - α) q0 + α q1.
    """

    def __init__(
        self,
        at: PointMeasures,
        density: Any,
        dissipates: bool,
        alpha: float,
    ) -> None:
        """Take strains and law of n springs or the like, which are evaluated together.

        The start of a step is set by `keep`, its length [s] by the attribute `h`.

        Until `keep` is called the unknowns at the start are zero, and until `h` is set it is 1 s.
        """
        self.at = at
        self.density = density
        self._dissipates = dissipates
        self._α = alpha
        self.h = 1.0
        # Unknowns q1 (n, D), vectors (n, 3k), strains e1 (n, m) and stresses (n, m) with their
        # derivatives (n, m, m) of the last evaluation: forces and tangent of one
        # iterate use the same ones.
        self._known: tuple[Array, Array, Array, tuple[Array, Array]] | None = None
        self.keep(np.zeros((at.n, at.D)))

    def keep(self, q0: Array) -> None:
        """Set the unknowns q0 (n, D) at the start of a step."""
        self._Y0 = self.at.vectors(q0)
        self._known = None
        self.e0 = self.at.measure(self._Y0)

    def force(self, q1: Array) -> Array:
        """Forces S_mean·De(q_mid) (n, D) [N] of a step on the unknowns of n springs or the like.

        e are their strains, quadratic in the unknowns q, S_mean the mean stress of the step, and
        q_mid the configuration in which forces act.  Forces are computed where there is stress:
        slack ropes and open stops cost little.

        Args:
            q1: unknowns (n, D), positions [m] and directors [-], at the end of the step.  A result
                is reused for the same array object: it must not be changed in place.
        """
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
        """Add the derivatives [N/m] of the forces by the unknowns at the end of the step to a
        matrix.

        Args:
            A: PETSc matrix of all unknowns, not yet assembled; changed in place.
            q1: unknowns (n, D), positions [m] and directors [-], of n springs or the like at the
                end of the step.
        """
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
        """Derivatives of the forces on the vectors that strains are made of, by these vectors.

        Each of n springs or the like has strains that are quadratic in k vectors: points [m] or
        directors [-].  Those without stress and stiffness are left out.

        Args:
            q1: unknowns (n, D), positions [m] and directors [-], at the end of the step.

        Returns:
            Stiffness (r, 3k, 3k) [N/m], and the indices (r,) of the r rows that have one, or a
            slice if all have.
        """
        # Y (n, 3k): the vectors; S (n, m): mean stresses; dS (n, m, m): their derivatives by the
        # strains at the end; α: weight of the end in the configuration where forces act.
        Y, _, (S, dS) = self._end(q1)
        on = _all_or_some(S.any(axis=1) | dS.any(axis=(1, 2)))
        slope_mid = self.at.slope(self._middle(Y, on), on)
        slope_end = self.at.slope(Y[on], on)
        # The derivative of S·De(q_mid): S depends on the end, De on the middle.  Not symmetric
        # where the two slopes differ.
        material = slope_mid.transpose(0, 2, 1) @ (dS[on] @ slope_end)
        geometric = self._α * self.at.geometric(S[on], on)
        return material + geometric, on

    def _middle(self, Y: Array, on: Any) -> Array:
        """Vectors (r, 3k) of the configuration in which forces act, of the rows `on`.

        Args:
            Y: the vectors (n, 3k) at the end of the step.
        """
        return (1 - self._α) * self._Y0[on] + self._α * Y[on]

    def _end(self, q1: Array) -> tuple[Array, Array, tuple[Array, Array]]:
        """Quantities at the end of the step, which are kept for the next call with the same array.

        Args:
            q1: unknowns (n, D), positions [m] and directors [-], of n springs or the like.

        Returns:
            The k vectors (n, 3k) of which the strains are made, strains e1 (n, m), and the mean
            stress (n, m) of the step with its derivatives (n, m, m) by e1.
        """
        # Y: the vectors, points [m] and directors [-].
        # The same array object, not equal numbers: a comparison would cost as much as it saves.
        if self._known is None or self._known[0] is not q1:
            Y = self.at.vectors(q1)
            e1 = self.at.measure(Y)
            self._known = q1, Y, e1, self._average(e1)
        return self._known[1:]

    def _average(self, e1: Array) -> tuple[Array, Array]:
        """Stress S_mean (n, m) of a step to the strain e1 (n, m), and dS_mean/de1 (n, m, m)."""
        if self._dissipates:
            return self.density.average(self.e0, e1, self.h)
        if self._α == 0.5:
            return self.density.average(self.e0, e1)
        # At equal strains the derivative of the average is half of ψ''.
        S, half = self.density.average(e1, e1)
        return S, 2 * half

    def energy(self) -> Array:
        """ψ (n,) at the start of the step."""
        if self._dissipates:
            return np.zeros(self.at.n)
        return self.density.energy(self.e0)

    def force_by_number(self, q1: Array, key: str) -> Array:
        """Derivatives (n, D) of the forces of a step by a number of the law, by a complex step.

        The laws are analytic in their numbers where they are smooth, so that nothing cancels.

        Args:
            q1: unknowns (n, D), positions [m] and directors [-], of n springs or the like at the
                end of the step.
            key: name of the number, an attribute of the density, e.g. "k", a stiffness.

        Returns:
            Forces [N] over the unit of the number.

        Raises:
            AttributeError: the density has no number of this name.
        """
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
        _, e1, _ = self._end(q1)
        energy: Array = self._varied(key, 1j * COMPLEX_STEP).energy(e1).imag / COMPLEX_STEP
        return energy

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

    def loss(self, q1: Array) -> Array:
        """Dissipated energy of each row of the measure (n,) in the step [J]."""
        _, e1, (S, _) = self._end(q1)
        return np.einsum("nm,nm->n", S, e1 - self.e0)


def _all_or_some(on: Any) -> Any:
    """Indices where it is true (n,); a slice, which copies nothing, where it is true everywhere."""
    if on.all():
        return slice(None)
    return np.flatnonzero(on)


class PointEnergies(Differentiable, CompiledTerms["PointStoredEnergy | PointDissipation"]):
    """All `PointStoredEnergy` and `PointDissipation` terms of a scene."""

    has_shape_derivative = True

    def __init__(
        self, terms: Sequence[PointStoredEnergy | PointDissipation], system: Assembly
    ) -> None:
        """Compile all energies and dampers between points: arrays and indices that stay the same in
        a run.

        Terms of one kind, such as all springs, are evaluated as one array.  Collective.

        Args:
            terms: the energies and dampers, in the same order on all ranks.
            system: the compiled scene, which has the numbering of the unknowns.

        Raises:
            InputError: a port whose nodes, weights and vectors do not belong together, or one of a
                body that is not in the scene.
        """
        tuples = [(term.name, term.measure.ports) for term in terms]
        refuse_ports_outside(system.comm, system.bodies, tuples)
        self._system = system
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
            stencil = Stencil(at, density, dissipates=dissipates, alpha=system.rule.alpha)
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
        # New values of numbers of laws, such as a stiffness, that `set_number` changed after the
        # compilation, by the identity of the term and the name of the number.
        self._numbers: dict[tuple[int, str], float] = {}

    def begin_step(self, t: float) -> None:
        """Start a step of length `system.h` [s]."""
        self._ends = None
        for stencil in self._stencils:
            stencil.h = self._system.h

    def update(self, linearly: bool) -> None:
        """Forget the unknowns of the last iterate."""
        self._ends = None

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

    def stresses(self, term: PointStoredEnergy) -> tuple[Array, Array]:
        """Measures and stresses of a term in the accepted state, of the rows of this rank.
        Collective.

        Args:
            term: of this scene.

        Returns:
            e (r, m) and ψ'(e) (r, m) of the r tuples of ports that this rank evaluates, see
            `point_measures.evaluated_here`.
        """
        stencil, i = self._find(term)
        k = self._stencils.index(stencil)
        measures = stencil.at.strain(self._gather(self._system.q0)[k])
        # The mean stress of a step without a change of the measures
        stresses, _ = stencil.density.average(measures, measures)
        rows = stencil.at.owner == i
        return measures[rows], stresses[rows]

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
                found.extend(np.bincount(stencil.at.owner, stencil.loss(q), len(terms)))
        return np.array(found)


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
    """Key of the energies and dampers that are evaluated as one array: equal for those of one kind.

    What they have in common: the class of the term and of its density (the law of the strains), the
    numbers of the density except those named in its `stacks`, which may be arrays, and the shapes
    of their strains.  A density without `stacks` has a key of its term alone.

    Args:
        term: a stored energy or damper between points.  Its measure, the strain, is ½ X·H X + L·X +
            c of the stacked vectors X of its ports, with H (m, 3k, 3k).

    Returns:
        A hashable key: the tuple of what terms have in common, or the identity of the term.
    """
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
    """One law for all rows of an array of springs or the like, with arrays (n,) of the numbers that
    differ.

    Args:
        of: index (n,) of the law to which each row belongs.
    """
    first = densities[0]
    if len(densities) == 1:
        return first
    stacked = {}
    for name in first.stacks:
        numbers = np.array([getattr(density, name) for density in densities])
        stacked[name] = numbers[of]
    return replace(first, **stacked)
