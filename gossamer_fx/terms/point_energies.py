"""Energies and dissipation of measures between points, as arrays: all terms of one kind are evaluated at once.

The rule is that of `discrete_gradient`: force S̄·De(q̄) with S̄·(e1 - e0) = ψ(e1) - ψ(e0), or the loss of the step.
With α = 1 the forces are those of the end of the step, S̄ = ψ'(e1).  Measures are evaluated on the rank of
their first port.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Protocol

import numpy as np
from petsc4py import PETSc

from gossamer_fx.algebra.point_measures import (
    Gather,
    PointMeasure,
    PointMeasures,
    add_blocks,
    nodes_of,
)
from gossamer_fx.model.body import Array
from gossamer_fx.model.parameters import Parameter
from gossamer_fx.model.roles import (
    Dissipation,
    Forces,
    IndependentOfShape,
    IterateObserver,
    PointParameters,
    Reversible,
    StateObserver,
    StepObserver,
    StoredEnergies,
    Tangents,
)
from gossamer_fx.terms.assembly import Assembly, CompiledTerms, Compiler

# Complex steps do not cancel, so that the step is so small that its square is round-off of any number.
COMPLEX_STEP = 1e-30


class PointDensity(Protocol):
    """Energy of the m strains e of a point measure; all arguments and results are arrays over n tuples of ports.

    A density whose numbers named in `stacks` may also be arrays (n,) shares one evaluation with others of its class.
    """

    def energy(self, e: Array) -> Array:
        """ψ(e) [J], (n,) of (n, m)."""
        ...

    def average(self, e0: Array, e1: Array) -> tuple[Array, Array]:
        """S̄ (n, m) and dS̄/de1 (n, m, m) with S̄·(e1 - e0) = ψ(e1) - ψ(e0); at e0 = e1 they are (ψ', ψ''/2)."""
        ...


class PointDamping(Protocol):
    """Stress against the rate of the m strains of a point measure, never with negative loss."""

    def average(self, e0: Array, e1: Array, h: float) -> tuple[Array, Array]:
        """S̄ (n, m) and dS̄/de1 (n, m, m) with S̄·(e1 - e0) ≥ 0, the loss in a step of h seconds."""
        ...


class Stencil:
    """Measures of one kind with one density: their forces, tangents and energies.

    With pairs that change from step to step, a new one is made for each list of them.
    """

    def __init__(
        self,
        at: PointMeasures,
        density: Any,
        dissipates: bool,
        alpha: float,
    ) -> None:
        self.at, self.density, self._dissipates, self._α = at, density, dissipates, alpha
        self.h = 1.0
        self._known: tuple[Array, Array, Array, tuple[Array, Array]] | None = (
            None  # of the unknowns last asked for
        )
        self.keep(np.zeros((at.n, at.D)))

    def keep(self, q0: Array) -> None:
        """Unknowns (n, D) at the start of a step."""
        self._Y0, self._known = self.at.vectors(q0), None
        self.e0 = self.at.measure(self._Y0)

    def force(self, q1: Array) -> Array:
        """S̄·De(q̄) (n, D), computed where there is stress: slack ropes and open stops cost little."""
        Y, _, (S, _) = self._end(q1)
        on = _all_or_some(S.any(axis=1))
        forces = self.at.forces(S[on][:, None] @ self.at.slope(self._middle(Y, on), on), on)[:, 0]
        if isinstance(on, slice):
            return forces
        found = np.zeros_like(q1)
        found[on] = forces
        return found

    def tangent(self, q1: Array) -> Array:
        """De(q̄)ᵀ dS̄/de1 De(q1) + α S̄·D²e (n, D, D), computed where it is not zero."""
        K, on = self._stiffness(q1)
        if isinstance(on, slice):
            return self.at.stiffness(K)
        found = np.zeros((self.at.n, self.at.D, self.at.D))
        found[on] = self.at.stiffness(K, on)
        return found

    def add_tangent(self, A: PETSc.Mat, q1: Array) -> None:
        """Add the same to a matrix."""
        at = self.at
        if at.share_unknowns:
            add_blocks(
                A, at.indices[:1], at.indices[:1], at.sum_of_stiffness(*self._stiffness(q1))[None]
            )
        else:
            add_blocks(A, at.indices, at.indices, self.tangent(q1))

    def _stiffness(self, q1: Array) -> tuple[Array, Any]:
        """Stiffness with respect to the measured vectors (k, 3k, 3k), and the k rows that have one."""
        Y, _, (S, D) = self._end(q1)
        on = _all_or_some(S.any(axis=1) | D.any(axis=(1, 2)))
        B, B1 = self.at.slope(self._middle(Y, on), on), self.at.slope(Y[on], on)
        return B.transpose(0, 2, 1) @ (D[on] @ B1) + self._α * self.at.geometric(S[on], on), on

    def _middle(self, Y: Array, on: Any) -> Array:
        """The vectors of the configuration in which forces act, of the rows `on`."""
        return (1 - self._α) * self._Y0[on] + self._α * Y[on]

    def _end(self, q1: Array) -> tuple[Array, Array, tuple[Array, Array]]:
        """Vectors and strain at the end of the step; its stress, and the derivative with respect to the end strain."""
        if self._known is None or self._known[0] is not q1:
            Y = self.at.vectors(q1)
            e1 = self.at.measure(Y)
            self._known = q1, Y, e1, self._average(e1)
        return self._known[1:]

    def _average(self, e1: Array) -> tuple[Array, Array]:
        if self._dissipates:
            return self.density.average(self.e0, e1, self.h)
        if self._α == 0.5:
            return self.density.average(self.e0, e1)
        S, half = self.density.average(e1, e1)
        return S, 2 * half

    def energy(self) -> Array:
        """ψ (n,) at the start of the step."""
        return np.zeros(self.at.n) if self._dissipates else self.density.energy(self.e0)

    def force_by_number(self, q1: Array, key: str) -> Array:
        """∂force/∂number (n, D) of a number of the density, by a complex step.

        The densities are analytic in their numbers where they are smooth, so that nothing cancels.
        """
        Y, e1, _ = self._end(q1)
        density = self.density
        self.density = self._varied(key, 1j * COMPLEX_STEP)
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
        """Give a number of the density a value at some tuples of ports, of which `at` (n,) is true."""
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
    return slice(None) if on.all() else np.flatnonzero(on)


class PointEnergies(
    StepObserver,
    IterateObserver,
    StateObserver,
    Forces,
    Tangents,
    StoredEnergies,
    Dissipation,
    PointParameters,
    Reversible,
    IndependentOfShape,
    CompiledTerms["PointStoredEnergy | PointDissipation"],
):
    """All `PointStoredEnergy` and `PointDissipation` terms of a scene."""

    def __init__(
        self, terms: Sequence[PointStoredEnergy | PointDissipation], system: Assembly
    ) -> None:
        self._system, self._names = (
            system,
            [t.name for t in terms if isinstance(t, PointStoredEnergy)],
        )
        groups: dict[Any, list[PointStoredEnergy | PointDissipation]] = {}
        for term in terms:
            groups.setdefault(_kind(term), []).append(term)
        self._groups = []
        for alike in groups.values():
            at = PointMeasures(system.numbering, system.bodies, [term.measure for term in alike])
            density = _stacked([term.density for term in alike], at.owner)
            stencil = Stencil(
                at, density, isinstance(alike[0], PointDissipation), system.rule.alpha
            )
            self._groups.append((alike, stencil))
        self._stencils = [stencil for _, stencil in self._groups]
        self.losses = [
            t.name for alike, _ in self._groups for t in alike if isinstance(t, PointDissipation)
        ]
        self._gather = Gather(system.numbering, [stencil.at.indices for stencil in self._stencils])
        self._ends: list[Array] | None = None  # unknowns of the stencils in q1
        # Numbers of terms that were changed after the compilation, by the identity of the term.
        self._numbers: dict[tuple[int, str], float] = {}

    def begin_step(self, t: float) -> None:
        self._ends = None
        for stencil in self._stencils:
            stencil.h = self._system.h

    def update(self, linearly: bool) -> None:
        self._ends = None

    def _at_end(self) -> list[Array]:
        if self._ends is None:
            self._ends = self._gather(self._system.q1)
        return self._ends

    def commit(self) -> None:
        for stencil, q in zip(self._stencils, self._gather(self._system.q0), strict=True):
            stencil.keep(q)

    def add_forces(self, r: PETSc.Vec) -> None:
        for stencil, q in zip(self._stencils, self._at_end(), strict=True):
            r.setValues(
                stencil.at.indices.ravel(),
                stencil.force(q).ravel(),
                addv=PETSc.InsertMode.ADD_VALUES,
            )
        r.assemble()

    def add_tangents(self, A: PETSc.Mat) -> None:
        for stencil, q in zip(self._stencils, self._at_end(), strict=True):
            stencil.add_tangent(A, q)

    def energies(self) -> dict[str, float]:
        found = dict.fromkeys(self._names, 0.0)
        for terms, stencil in self._groups:
            if isinstance(terms[0], PointStoredEnergy):
                shares = np.bincount(stencil.at.owner, stencil.energy(), len(terms))
                for term, share in zip(terms, shares, strict=True):
                    found[term.name] += float(share)
        return found

    # ---- sensitivities ---------------------------------------------------------------------------------

    def get_number(self, term: PointStoredEnergy | PointDissipation, key: str) -> Array:
        return np.atleast_1d(self._numbers.get((id(term), key), getattr(term.density, key)))

    def set_number(
        self, term: PointStoredEnergy | PointDissipation, key: str, value: Array
    ) -> None:
        stencil, i = self._find(term)
        self._numbers[id(term), key] = float(value[0])
        stencil.set_number(key, float(value[0]), stencil.at.owner == i)

    def work_by_number(
        self, term: PointStoredEnergy | PointDissipation, key: str, w: PETSc.Vec
    ) -> Array:
        stencil, i = self._find(term)
        k = self._stencils.index(stencil)
        forces = stencil.force_by_number(self._at_end()[k], key)
        work = np.sum(forces * self._gather(w)[k], axis=1)
        return np.array([work[stencil.at.owner == i].sum()])

    def energy_by_number(self, term: PointStoredEnergy | PointDissipation, key: str) -> Array:
        stencil, i = self._find(term)
        energies = stencil.energy_by_number(self._at_end()[self._stencils.index(stencil)], key)
        return np.array([energies[stencil.at.owner == i].sum()])

    def _find(self, term: PointStoredEnergy | PointDissipation) -> tuple[Stencil, int]:
        """The stencil of a term, and the number of the term in it."""
        for terms, stencil in self._groups:
            for i, one in enumerate(terms):
                if one is term:
                    return stencil, i
        raise ValueError(f"'{term.name}' is not in this scene")

    def dissipated(self) -> Array:
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
    """What terms must have in common to be one array."""
    density, stacks = term.density, getattr(term.density, "stacks", None)
    if stacks is None:
        return id(term)
    others = tuple(
        (name, value) for name, value in sorted(vars(density).items()) if name not in stacks
    )
    return type(term), type(density), others, term.measure.H.shape, nodes_of(term.measure)


def _stacked(densities: Sequence[Any], of: Array) -> Any:
    """One density for all rows; row k belongs to densities[of[k]]."""
    first = densities[0]
    if len(densities) == 1:
        return first
    return replace(
        first,
        **{name: np.array([getattr(d, name) for d in densities])[of] for name in first.stacks},
    )
