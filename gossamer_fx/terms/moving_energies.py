"""Energies ½ a(t; q, q) of a quadratic form that changes with time, such as those of clamps that turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import ufl
from dolfinx import fem, la
from petsc4py import PETSc

from gossamer_fx.forms.compilation import compile_form
from gossamer_fx.forms.kinematics import Expr
from gossamer_fx.model.terms import Array, Assembly, CompiledTerms, Indices, MeshBody


class MovingEnergies(CompiledTerms):
    """All `MovingEnergy` terms of a scene.

    With the matrices K0, K1 of both ends of a step the force is ½ (K0 + K1) q̄; what changes the form supplies
    ¼ (q1·(K1 - K0) q1 + q0·(K1 - K0) q0), and both together change the energy exactly.
    """

    def __init__(self, terms: Sequence[MovingEnergy], system: Assembly) -> None:
        self._system, self._compiled = system, []
        for term in terms:
            k = system.bodies.index(term.body)
            at, α = system.fields[k], system.rule.alpha
            before, after = fem.Function(term.body.space), fem.Function(term.body.space)

            def form(x: Expr, w: Expr, term: MovingEnergy = term, d: tuple[Expr, Expr] = (before, after)) -> ufl.Form:
                # in statics only the end counts
                return term.form(x, w, d[1]) if α == 1.0 else term.form(x, w, d[0]) / 2 + term.form(x, w, d[1]) / 2

            changed = [term.form(q, q, d) for q in (at.q0, at.q1) for d in (before, after)]
            self._compiled.append(
                _Compiled(
                    k,
                    term,
                    before,
                    after,
                    la.vector(term.body.block.index_map, term.body.block.size),
                    compile_form(form(at.mid, at.w)),
                    compile_form(at.α * form(at.dq, at.w)),
                    compile_form((changed[1] - changed[0] + changed[3] - changed[2]) / 4),
                    compile_form(changed[0] / 2),
                )
            )
            _set(before, term, system.time)

    def begin(self, t: float) -> None:
        for c in self._compiled:
            _set(c.after, c.term, self._system.time + self._system.h)

    def add_forces(self, r: PETSc.Vec) -> None:
        for c in self._compiled:
            c.force.array[:] = 0
            fem.assemble_vector(c.force.array, c.residual)
            c.force.scatter_reverse(la.InsertMode.add)
            owned = self._system.numbering.owned(c.k)
            with r as values:
                values[owned] += c.force.array[: owned.stop - owned.start]

    def tangent_forms(self, k: int) -> list[fem.Form]:
        return [c.tangent for c in self._compiled if c.k == k]

    def supplied(self) -> float:
        return sum(float(fem.assemble_scalar(c.work)) for c in self._compiled)

    def keep(self) -> None:
        for c in self._compiled:
            _set(c.before, c.term, self._system.time)

    def energies(self) -> dict[str, float]:
        found: dict[str, float] = {}
        for c in self._compiled:
            found[c.term.name] = found.get(c.term.name, 0.0) + float(fem.assemble_scalar(c.energy))
        return found


@dataclass(frozen=True, eq=False)
class MovingEnergy:
    """Stored energy ½ a(d; q, q) of a symmetric bilinear form a(d; q, w), written form(q, w, d), that depends on vectors
    d: `values(t)` (n, 3) at the local `nodes` (n,) of the body at time t.  The work of what moves them is supplied.
    """

    name: str
    body: MeshBody
    form: Callable[[Expr, Expr, Expr], ufl.Form]
    nodes: Indices
    values: Callable[[float], Array]
    compiler: ClassVar[type[CompiledTerms]] = MovingEnergies


@dataclass(frozen=True, eq=False)
class _Compiled:
    k: int
    term: MovingEnergy
    before: fem.Function
    after: fem.Function
    force: la.Vector
    residual: fem.Form
    tangent: fem.Form
    work: fem.Form
    energy: fem.Form


def _set(d: fem.Function, term: MovingEnergy, t: float) -> None:
    d.x.array.reshape(-1, 3)[term.nodes] = np.asarray(term.values(t))
