"""Energies ½ a(t; q, q) of a quadratic form that changes with time, such as those of clamps that turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import ufl
from dolfinx import fem, la
from petsc4py import PETSc

from gossamer_fx.forms.compilation import compile_form, constant
from gossamer_fx.forms.kinematics import Expr
from gossamer_fx.model.body import Array, Body, Indices, MeshBody
from gossamer_fx.model.roles import Forces, StepObserver, StoredEnergies, Supply, TangentForms
from gossamer_fx.terms.assembly import Assembly, CompiledTerms, Compiler


class MovingEnergies(
    StepObserver, Forces, TangentForms, StoredEnergies, Supply, CompiledTerms["MovingEnergy"]
):
    """All `MovingEnergy` terms of a scene.

    With the matrices K0, K1 of both ends of a step the force is ½ (K0 + K1) q̄; what changes the form supplies
    ¼ (q1·(K1 - K0) q1 + q0·(K1 - K0) q0), and both together change the energy exactly.
    """

    def __init__(self, terms: Sequence[MovingEnergy], system: Assembly) -> None:
        self._system, self._compiled = system, []
        for term in terms:
            at = system.fields[term.body]
            d0 = fem.Function(term.body.space)
            d1 = fem.Function(term.body.space)
            # the matrices of both ends count alike; in statics only that of the end does
            share = constant(term.body.space.mesh, 1.0 if system.rule.alpha == 1.0 else 0.5)
            ends = (d1,) if system.rule.alpha == 1.0 else (d0, d1)
            changed = [term.form(q, q, d) for q in (at.q0, at.q1) for d in (d0, d1)]
            self._compiled.append(
                _Compiled(
                    term,
                    d0,
                    d1,
                    la.vector(term.body.block.index_map, term.body.block.size),
                    compile_form(sum(share * term.form(at.mid, at.w, d) for d in ends)),
                    compile_form(sum(at.α * share * term.form(at.dq, at.w, d) for d in ends)),
                    compile_form(changed[1] - changed[0] + changed[3] - changed[2]),
                    compile_form(changed[0]),
                )
            )

    def begin_step(self, t: float) -> None:
        for c in self._compiled:
            _set(c.before, c.term, self._system.time)
            _set(c.after, c.term, self._system.time + self._system.h)

    def add_forces(self, r: PETSc.Vec) -> None:
        for c in self._compiled:
            c.force.array[:] = 0
            fem.assemble_vector(c.force.array, c.residual)
            c.force.scatter_reverse(la.InsertMode.add)
            owned = self._system.block(c.term.body).owned
            with r as values:
                values[owned] += c.force.array[: owned.stop - owned.start]

    def tangent_forms(self, body: Body) -> list[fem.Form]:
        return [c.tangent for c in self._compiled if c.term.body is body]

    def supplied(self) -> float:
        return sum(float(fem.assemble_scalar(c.work)) / 4 for c in self._compiled)

    def energies(self) -> dict[str, float]:
        found: dict[str, float] = {}
        for c in self._compiled:
            _set(c.before, c.term, self._system.time)
            found[c.term.name] = (
                found.get(c.term.name, 0.0) + float(fem.assemble_scalar(c.energy)) / 2
            )
        return found


@dataclass(frozen=True, eq=False)
class MovingEnergy:
    """Stored energy ½ a(d; q, q) of a symmetric bilinear form, written form(q, w, d), that depends on moving vectors d.

    d is `values(t)` (n, 3) at the local `nodes` (n,) of the body at time t.  The work of what moves it is supplied.
    """

    name: str
    body: MeshBody
    form: Callable[[Expr, Expr, Expr], ufl.Form]
    nodes: Indices
    values: Callable[[float], Array]
    compiler: ClassVar[Compiler] = MovingEnergies


@dataclass(frozen=True, eq=False)
class _Compiled:
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
