"""Rows: what acts between ports of bodies by a law of point measures.

A law is a plain function of the measures of one tuple of ports at both ends of a step, of history
variables at its start, of its length and of numbers:

    law(e0, e1, z0, h, numbers) -> Response(stress, energy, loss, history, ...)

It is compiled with its derivatives (`core.laws`) and called for all tuples at once; terms with the
same law are one array.  With the stress S_mean the force of a step is S_mean·De(q_mid), and

    S_mean·(e1 - e0) = ψ1 - ψ0 + loss - supplied

closes the energy balance, see `discrete_gradient`.  A rule that does not conserve energy takes the
stress of one strain instead.  Measures are evaluated on the rank of their first port.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice, pairwise
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.algebra.named_rows import NamedRows
from gossamer_fx.core.algebra.numbering import GlobalIndices
from gossamer_fx.core.algebra.point_measures import (
    Gather,
    Measure,
    PointMeasure,
    PointMeasures,
    Ports,
    add_blocks,
    attach_all,
    evaluated_here,
    refuse_ports_outside,
)
from gossamer_fx.core.checks.lookups import check_midpoint
from gossamer_fx.core.laws.law import Derivatives, Law, compile_law
from gossamer_fx.core.laws.tracing import Number, at_most
from gossamer_fx.core.model.body import Array, Port
from gossamer_fx.core.model.terms import Parameter
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
    HistoryVariables,
)
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule


@dataclass(frozen=True)
class Response:
    """What the law of a tuple of ports returns for a step.

    Args:
        stress: S_mean (m,) [J per unit of the measures], the derivative of a mean energy.
        energy: ψ [J] at the end of the step.
        loss: dissipated energy [J] of the step.
        history: history variables z1 at the end of the step.
        supplied: work [J] of a motor in the step.
        excess: positive where the step leaves the range in which the law is known.
    """

    stress: Sequence[Number]
    energy: Number = 0.0
    loss: Number = 0.0
    history: Sequence[Number] = ()
    supplied: Number = 0.0
    excess: Number = -1.0


# law(e0, e1, z0, h, numbers); arguments and result are those of one tuple of ports.
RowLaw = Callable[[Sequence[Any], Sequence[Any], Sequence[Any], Any, Any], Response]


def positive_part(y: Number) -> Number:
    """max(y, 0) without a branch of the law."""
    return at_most(y, 0.0, holds=0.0, fails=y)


def one_sided_average(y0: Number, y1: Number) -> Number:
    """Average T_mean of T(y) = max(y, 0) along the straight path from y0 to y1, in any unit.

    It is exact, also where the path passes zero: T_mean (y1 - y0) = ½ max(y1, 0)² - ½ max(y0, 0)².
    It does not divide by a small change: that is done only where the path passes zero, and there
    |y1 - y0| >= |y1|.
    """
    pull0 = positive_part(y0)
    pull1 = positive_part(y1)
    passes_zero = at_most(
        y0,
        0.0,
        holds=at_most(y1, 0.0, holds=0.0, fails=1.0),
        fails=at_most(y1, 0.0, holds=1.0, fails=0.0),
    )
    # Elsewhere the divisor is 1: its quotient is not taken, and must not divide by zero.
    change = at_most(passes_zero, 0.5, holds=1.0, fails=y1 - y0)
    quotient = (pull1 * pull1 - pull0 * pull0) / (2 * change)
    # Where T is linear all the way, the trapezoidal rule is exact.
    return at_most(passes_zero, 0.5, holds=(pull0 + pull1) / 2, fails=quotient)


class RowHistory(HistoryVariables):
    """History variables of the tuples of ports of one term, and driven numbers at the start of the
    step, on the rank that evaluates them.

    Attributes:
        present: (n, z) at the start of the step; written to by the engine.
        before: (n, z) at the start of the last accepted step.
    """

    def __init__(
        self,
        ports: Sequence[Ports],
        variables: Mapping[str, float | Array],
        driven: Mapping[str, Callable[[float], float]],
    ) -> None:
        self._here = np.array(evaluated_here(ports), dtype=np.int64)
        self._count = len(ports)
        first = next(port for port in ports[0] if isinstance(port, Port))
        self._comm = first.body.comm
        self._follows_time = bool(driven)
        columns = [np.broadcast_to(value, self._count)[self._here] for value in variables.values()]
        columns += [np.full(len(self._here), course(0.0)) for course in driven.values()]
        self.present: Array = np.stack(columns, axis=1).astype(float)
        self.before: Array = self.present.copy()

    def all_tuples(self, values: Array) -> Array:
        """Values (n, z) of this rank's tuples as those of all tuples of the term.  Collective."""
        table = np.zeros((self._count, values.shape[1]))
        table[self._here] = values
        return np.asarray(self._comm.allreduce(table))

    def get_history(self) -> dict[str, Any]:
        return {"tuples": NamedRows(self._here, np.hstack([self.present, self.before]))}

    def shape_history(self) -> dict[str, Any] | None:
        # A number that is given over time has the value of the time at which a scene starts.
        return None if self._follows_time else self.get_history()

    def set_history(self, state: dict[str, Any]) -> None:
        values = state["tuples"].of(self._here)
        self.present[:], self.before[:] = np.split(values, 2, axis=1)


@dataclass(frozen=True)
class SlopesByState:
    """Outputs (n, outputs) of a law of rows, and their derivatives by the strains at the start and
    at the end of a step (n, outputs, m), and by history variables at its start (n, outputs, z)."""

    outputs: Array
    start: Array
    end: Array
    history: Array


class LawOfRows:
    """A compiled law of rows, and where its inputs and outputs stand.  Collective.

    Args:
        law: of one tuple of ports.
        m: number of measures.
        numbers: names of its numbers, with the length of a vector or None for one number.
        variables: number of history variables.
        driven: names of numbers that change with time, `name`0 at the start and `name`1 at the end
            of a step.
        is_viscous: whether it takes the strains at both ends with every stress rule.
        comm: whose ranks compile it together.
    """

    def __init__(
        self,
        law: RowLaw,
        m: int,
        numbers: Mapping[str, int | None],
        comm: MPI.Intracomm,
        *,
        variables: int = 0,
        driven: Sequence[str] = (),
        is_viscous: bool = False,
    ) -> None:
        self.m = m
        self.variables = variables
        self.driven_count = len(driven)
        self.is_viscous = is_viscous
        at_both_ends = [f"{name}{end}" for end in "01" for name in driven]
        self._sizes: dict[str, int | None] = dict.fromkeys(at_both_ends) | dict(numbers)
        self._law = law
        self._comm = comm
        # Columns of the inputs
        self.start = slice(0, m)
        self.end = slice(m, 2 * m)
        self.history = slice(2 * m, 2 * m + variables)
        self.length_of_step = 2 * m + variables
        first = self.length_of_step + 1
        self.driven_start = slice(first, first + len(driven))
        self.driven_end = slice(first + len(driven), first + 2 * len(driven))
        self._names = [f"e0_{i}" for i in range(m)] + [f"e1_{i}" for i in range(m)]
        self._names += [f"z_{i}" for i in range(variables)] + ["h"]
        for name, size in self._sizes.items():
            self._names += [name] if size is None else [f"{name}_{i}" for i in range(size)]
        self.numbers = slice(self.driven_end.stop, len(self._names))
        self.width = len(self._names)
        # Columns of the outputs behind the stresses
        self.energy, self.loss, self.supplied, self.excess = range(m, m + 4)
        self.next_history = slice(m + 4, m + 4 + variables)
        self._by_end = self._compile(self._names[self.end])
        # Compiled for gradients
        self._by_number: Law | None = None
        self._by_state: Law | None = None

    def _compile(self, by: Sequence[str]) -> Law:
        return compile_law(
            self._of_one_row,
            by=by,
            comm=self._comm,
            names=self._names,
            output_count=self.next_history.stop,
        )

    def _of_one_row(self, *inputs: Number) -> list[Number]:
        """The law as a function of one list of numbers."""
        given = iter(inputs)

        def several(count: int) -> tuple[Number, ...]:
            return tuple(islice(given, count))

        e0 = several(self.m)
        e1 = several(self.m)
        z0 = several(self.variables)
        h = next(given)
        numbers = {}
        for name, size in self._sizes.items():
            numbers[name] = next(given) if size is None else several(size)
        response = self._law(e0, e1, z0, h, SimpleNamespace(**numbers))
        totals = (response.energy, response.loss, response.supplied, response.excess)
        return [*response.stress, *totals, *response.history]

    @property
    def derivatives(self) -> Derivatives:
        """How derivatives are taken."""
        return self._by_end.derivatives

    def column(self, name: str) -> int:
        """The column of a number among the inputs."""
        return self._names.index(name)

    def __call__(self, x: Any, *, slopes: bool) -> tuple[Array, Array]:
        """Outputs (n, outputs) of inputs (n, width), and with `slopes` their derivatives (n,
        outputs, m) by e1."""
        return self._by_end.of_rows(x, slopes=slopes)

    def by_state(self, x: Any) -> SlopesByState:
        """Derivatives by the strains at both ends and by history variables at the start.
        Collective at the first call."""
        if self._by_state is None:
            self._by_state = self._compile(self._names[: self.history.stop])
        outputs, slopes = self._by_state.of_rows(x)
        return SlopesByState(
            outputs=outputs,
            start=slopes[:, :, self.start],
            end=slopes[:, :, self.end],
            history=slopes[:, :, self.history],
        )

    def by_number(self, x: Any, name: str) -> Array:
        """Derivatives (n, outputs) by a number.  Collective at the first call."""
        scalars = [name for name, size in self._sizes.items() if size is None]
        if self._by_number is None:
            self._by_number = self._compile(scalars)
        return self._by_number.of_rows(x)[1][:, :, scalars.index(name)]


class Stencil:
    """Measures of one kind with one law: their forces, tangents and energies, with forces at q_mid
    = (1 - α) q0 + α q1.

    In the methods q1 (n, D) are the unknowns of n tuples of ports at the end of the step, positions
    [m] and directors [-].  A result is reused for the same array object: it must not be changed in
    place.  With pairs that change from step to step, a new stencil is made for each list of them.

    Args:
        at: the measures.
        law: compiled for as many measures.
        numbers: (n, numbers) of each tuple, or of all of them (numbers,).
        rule: which stress acts in a step.
        state: (n, z) history variables and driven numbers at the start, changed in place.

    Attributes:
        advances_in_search: whether history variables change in each pseudo-step of a search for
            rest, and not at its start alone.
        h: length [s] of the step, 1 s until it is set.
        e0: measures (n, m) at the start of the step, zero until `keep` sets it.
        driven: (n, d) driven numbers at the end of the step.
    """

    advances_in_search: ClassVar[bool] = False

    def __init__(
        self,
        at: PointMeasures,
        law: LawOfRows,
        numbers: Array | Sequence[float],
        rule: StressRule,
        state: Array | None = None,
    ) -> None:
        self.at = at
        self.law = law
        self._rule = rule
        self._takes_mid_strain = rule.takes_mid_strain and not law.is_viscous
        self.h = 1.0
        self.state: Array = np.zeros((at.n, 0)) if state is None else state
        self.before = self.state.copy()
        self.driven = self.state[:, law.variables :].copy()
        self._has_begun = False
        self._x = np.zeros((at.n, law.width))
        self._x[:, law.numbers] = numbers
        self.e0: Array = np.zeros((at.n, law.m))
        # Measures of the initial state, and the history variables that were given for it.
        self._first_e: Array = self.e0
        self._given: Array = np.zeros((at.n, law.variables))
        # Stresses and their derivatives by the end of a step whose ends are exchanged.
        self._exchanged: tuple[Array, Array] | None = None
        # Of a backward pass: derivative (n, z) of the result by the history variables at the end of
        # the present step, through later steps.
        self.by_history: Array = np.zeros((at.n, law.variables))
        # Unknowns q1 (n, D), vectors (n, 3k), and stresses (n, m) with their derivatives (n, m, m)
        # of the last evaluation, for forces and tangent of one iterate.
        self._known: tuple[Array, Array, Array, Array] | None = None
        self.start_from(np.zeros((at.n, at.D)))

    @property
    def numbers(self) -> Array:
        """Numbers (n, numbers) of the law."""
        return self._x[:, self.law.numbers]

    def keep(self, q0: Array) -> None:
        """Start the next step from the unknowns q0 (n, D), at which the last one ended."""
        Y0 = self.at.vectors(q0)
        e0 = self.measured(Y0)
        if self._has_begun:
            self._advance(e0)
        else:
            self._begin(e0)
        self._start(Y0, e0)

    def start_from(self, q0: Array) -> None:
        """Set the unknowns q0 (n, D) at the start of a step, with the present history variables."""
        Y0 = self.at.vectors(q0)
        self._start(Y0, self.measured(Y0))

    def _start(self, Y0: Array, e0: Array) -> None:
        """Set the vectors (n, 3k) and measures (n, m) at the start of a step."""
        self._Y0 = Y0
        self.e0 = e0
        self._known = None
        self._exchanged = None

    def measured(self, Y: Array) -> Array:
        """Measures (n, m) of vectors Y (n, 3k)."""
        return self.at.measure(Y)

    def measured_at(self, q: Array) -> Array:
        """Measures (n, m) at unknowns q (n, D)."""
        return self.at.strain(q)

    def _begin(self, e: Array) -> None:
        """Set the history variables of the initial state e (n, m), as if it had been reached before
        the run."""
        law = self.law
        self._has_begun = True
        self._first_e = e
        if law.variables:
            self._given = self.state[:, : law.variables].copy()
            self.state[:, : law.variables] = self.resting_history(e)
            self.before[:] = self.state

    def _advance(self, e1: Array) -> None:
        """Set the history variables at the end e1 (n, m) of a step."""
        law = self.law
        if not self.state.shape[1]:
            return
        self.before[:] = self.state
        # In a search for rest most change at its start only, not in its pseudo-steps.
        if self.advances_in_search or not self._rule.is_static:
            self.state[:, : law.variables] = self._outputs(self.e0, e1)[:, law.next_history]
        self.state[:, law.variables :] = self.driven

    def begin_search(self) -> None:
        """Set the history variables of the accepted state, from which a search for rest starts."""
        if self.law.variables and not self.advances_in_search:
            self.state[:, : self.law.variables] = self.resting_history(self.e0)

    def resting_history(self, e: Array) -> Array:
        """History variables (n, z) of a state that stays at the measures e (n, m)."""
        return self._outputs(e, e, None, 0.0)[:, self.law.next_history]

    def _outputs(self, *inputs: Any) -> Array:
        """Outputs (n, outputs) of the law for `_inputs`."""
        return self.law(self._inputs(*inputs), slopes=False)[0]

    def _inputs(
        self,
        e0: Array,
        e1: Array,
        driven: tuple[Array, Array] | None = None,
        h: float | None = None,
    ) -> Array:
        """Inputs (n, width) of the law between two measures (n, m), with driven numbers (n, d) at
        both ends, by default those of the step; overwritten by the next call."""
        law = self.law
        x = self._x
        x[:, law.start] = e0
        x[:, law.end] = e1
        x[:, law.length_of_step] = self.h if h is None else h
        if self.state.shape[1]:
            start, end = driven or (self.state[:, law.variables :], self.driven)
            x[:, law.history] = self.state[:, : law.variables]
            x[:, law.driven_start] = start
            x[:, law.driven_end] = end
        return x

    @property
    def _takes_one_end(self) -> bool:
        """Whether the stress is that of one strain and not the mean of a path."""
        return not (self._rule.conserves or self.law.is_viscous)

    def _step_inputs(self, e1: Array) -> Array:
        """Inputs of the law for the stress of the step to e1 (n, m) by the rule."""
        if self._takes_one_end:
            return self._inputs(e1, e1, (self.driven, self.driven))
        return self._inputs(self.e0, e1)

    def force(self, q1: Array) -> Array:
        """Forces S_mean·De(q_mid) (n, D) [N] of a step on the unknowns, with the mean stress
        S_mean.  They are computed where there is stress: slack ropes and open stops cost little."""
        # Y (n, 3k): the vectors of which the strains are made; S (n, m): their mean stresses.
        Y, S, _ = self._end(q1)
        on = _all_or_some(S.any(axis=1))
        forces_on_vectors = S[on][:, None] @ self._slope_of_step(Y, on)
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
        Y, S, dS = self._end(q1)
        on = _all_or_some(S.any(axis=1) | dS.any(axis=(1, 2)))
        slope_mid = self._slope_of_step(Y, on)
        # The slope of the strain of S by the vectors at the end.  Not that of De in S·De(q_mid), so
        # that the tangent is not symmetric, unless the rule takes the strain in the middle.
        slope: Array = self._rule.alpha * slope_mid
        if not self._takes_mid_strain:
            slope = self.at.slope(Y[on], on)
        material = slope_mid.transpose(0, 2, 1) @ (dS[on] @ slope)
        return material + self._geometric(S, Y, on), on

    def _slope_of_step(self, Y: Array, on: Any) -> Array:
        """Derivatives De (r, m, 3k) of the measures by vectors, by which stresses act in a step to
        the vectors Y (n, 3k), of the rows `on`; along a step they are the change of the measures.
        """
        return self.at.slope(self._middle(Y, on), on)

    def _geometric(self, S: Array, Y: Array, on: Any) -> Array:
        """Stiffness (r, 3k, 3k): stresses S (n, m) times the derivatives of `_slope_of_step` by the
        vectors Y (n, 3k) at the end, of the rows `on`."""
        stiffness: Array = self._rule.alpha * self.at.geometric(S[on], on)
        return stiffness

    def _middle(self, Y: Array, on: Any) -> Array:
        """Vectors (r, 3k) of the configuration in which forces act, of the rows `on`, from those Y
        (n, 3k) at the end of the step."""
        α = self._rule.alpha
        return (1 - α) * self._Y0[on] + α * Y[on]

    def _strain(self, Y: Array) -> Array:
        """Strains (n, m) that the rule takes, of the vectors Y (n, 3k) at the end of the step."""
        of_strain = self._middle(Y, slice(None)) if self._takes_mid_strain else Y
        return self.measured(of_strain)

    def _end(self, q1: Array) -> tuple[Array, Array, Array]:
        """The k vectors (n, 3k) of which the strains are made at q1, and the mean stress (n, m) of
        the step with its derivatives (n, m, m) by the strains that the rule takes."""
        # The same array object, not equal numbers: a comparison would cost as much as it saves.
        if self._known is None or self._known[0] is not q1:
            Y = self.at.vectors(q1)
            if self._exchanged is not None:
                return Y, *self._exchanged
            outputs, slopes = self.law(self._step_inputs(self._strain(Y)), slopes=True)
            m = self.law.m
            # Both strains of a mean are that of the end: each has half of the derivative.
            dS = 2 * slopes[:, :m] if self._takes_one_end else slopes[:, :m]
            self._known = q1, Y, outputs[:, :m], dS
        return self._known[1:]

    def stresses(self, q1: Array) -> tuple[Array, Array]:
        """Mean stresses (n, m) of a step, and the measures (n, m) of the configuration in which
        they act."""
        Y, S, _ = self._end(q1)
        return S, self.measured(self._middle(Y, slice(None)))

    def energy(self) -> Array:
        """ψ (n,) at the start of the step."""
        driven = self.state[:, self.law.variables :]
        return self._outputs(self.e0, self.e0, (driven, driven))[:, self.law.energy]

    def of_step(self, q1: Array) -> Array:
        """Outputs (n, outputs) of the law for the step from its start to q1, whatever the rule."""
        return self._outputs(self.e0, self.measured_at(q1))

    def stress_slopes(self, q: Array) -> Array:
        """Derivatives (n, m, m) of the stresses of a state that stays at q (n, D) by its
        measures."""
        # Of a damper there is no force at rest.
        if self.law.is_viscous:
            return np.zeros((self.at.n, self.law.m, self.law.m))
        e = self.measured(self.at.vectors(q))
        _, slopes = self.law(self._inputs(e, e, (self.driven, self.driven)), slopes=True)
        # Both strains of a mean are that of the state: each has half of the derivative.
        found: Array = 2 * slopes[:, : self.law.m]
        return found

    def stress_by_number(self, q: Array, name: str) -> Array:
        """Derivatives (n, m) of the stresses of a state that stays at q (n, D) by a number of the
        law."""
        e = self.measured(self.at.vectors(q))
        return self.law.by_number(self._inputs(e, e), name)[:, : self.law.m]

    def force_by_number(self, q1: Array, name: str) -> Array:
        """Derivatives (n, D) of the forces [N] of a step by a number of the law."""
        Y = self.at.vectors(q1)
        by_number = self.law.by_number(self._step_inputs(self._strain(Y)), name)
        dS = by_number[:, : self.law.m]
        return self._forces_of(dS, self._slope_of_step(Y, slice(None)))

    def energy_by_number(self, q1: Array, name: str) -> Array:
        """∂ψ/∂number (n,) at the end of the step, at given history variables."""
        e1 = self.measured_at(q1)
        x = self._inputs(e1, e1)
        slopes = self.law.by_number(x, name)
        found = slopes[:, self.law.energy]
        if self.law.variables:
            by_history = self._energy_slopes(x)
            found = found - np.sum(by_history * slopes[:, self.law.next_history], axis=1)
        return found

    # ---- gradients through history variables -----------------------------------------------------

    @property
    def has_state(self) -> bool:
        """Whether its forces depend on more than the strains: history variables, driven numbers."""
        return self.state.shape[1] > 0

    def exchange(self, q0: Array) -> None:
        """Let the present step, which ends at q0 (n, D), run backwards.  With history variables the
        stress of the way back is another one: that of the step is stored, with its derivative by
        the start."""
        if not self.has_state:
            self.start_from(q0)
            return
        slopes = self._slopes_of_step(q0)
        m = self.law.m
        self.start_from(q0)
        self._exchanged = slopes.outputs[:, :m], slopes.start[:, :m]

    def _slopes_of_step(self, q1: Array) -> SlopesByState:
        """Of the step from its start to q1 (n, D), by a rule that conserves energy."""
        return self.law.by_state(self._inputs(self.e0, self.measured(self.at.vectors(q1))))

    def _forces_of(self, stresses: Array, slope: Array) -> Array:
        """Forces (n, D) of stresses (n, m) by slopes (n, m, 3k) of measures."""
        forces: Array = self.at.forces(stresses[:, None] @ slope)
        return forces[:, 0]

    def energy_by_history(self) -> Array:
        """Derivatives (n, z) of the energies at the start of the step by history variables."""
        driven = self.state[:, self.law.variables :]
        return self._energy_slopes(self._inputs(self.e0, self.e0, (driven, driven)))

    def _energy_slopes(self, x: Array) -> Array:
        """∂ψ/∂z (n, z) of states, whose inputs x have the same measures at both ends.

        The law has the energy E = ψ(e, z1) of the history variables z1 that it sets.  A state that
        has slipped is at the limit, and by round-off on either side of it, so that z1 follows z or
        e.  The derivatives of E and z1 give ∂ψ/∂z on both sides, as ∂ψ/∂e is the stress S:

            ∂ψ/∂z ∂z1/∂z = ∂E/∂z,    ∂ψ/∂z ∂z1/∂e = ∂E/∂e - S
        """
        law = self.law
        slopes = law.by_state(x)
        by_e = slopes.start + slopes.end
        energies = np.concatenate(
            [slopes.history[:, law.energy], by_e[:, law.energy] - slopes.outputs[:, : law.m]],
            axis=1,
        )
        variables = np.concatenate(
            [slopes.history[:, law.next_history], by_e[:, law.next_history]], axis=2
        )
        found: Array = (energies[:, None] @ np.linalg.pinv(variables))[:, 0]
        return found

    def end_products(self, q1: Array) -> Array:
        """Derivative (n, D) of later steps by the end q1 (n, D) of a step, through the history
        variables that it sets."""
        slopes = self._slopes_of_step(q1)
        by_end = np.einsum("nz,nzm->nm", self.by_history, slopes.end[:, self.law.next_history])
        return self._forces_of(by_end, self.at.slope(self.at.vectors(q1)))

    def start_products(self, q1: Array) -> Array:
        """The same by the start of the step."""
        slopes = self._slopes_of_step(q1)
        by_start = np.einsum("nz,nzm->nm", self.by_history, slopes.start[:, self.law.next_history])
        return self._forces_of(by_start, self.at.slope(self._Y0))

    def by_history_at_start(self, q1: Array, μ: Array) -> Array:
        """Derivative (n, z) of the result by the history variables at the start of a step to q1
        (n, D), which has the adjoint vector μ (n, D)."""
        slopes = self._slopes_of_step(q1)
        through_later = np.einsum(
            "ni,nij->nj", self.by_history, slopes.history[:, self.law.next_history]
        )
        slope = self.at.forces(self._slope_of_step(self.at.vectors(q1), slice(None)))
        works = (slope @ μ[..., None])[..., 0]
        return through_later - np.einsum("nm,nmz->nz", works, slopes.history[:, : self.law.m])

    def history_by_number(self, q1: Array, name: str) -> Array:
        """Derivatives (n, z) of the history variables at the end of a step to q1 (n, D) by a number
        of the law."""
        x = self._inputs(self.e0, self.measured(self.at.vectors(q1)))
        return self.law.by_number(x, name)[:, self.law.next_history]

    def _inputs_at_first(self) -> Array:
        """Inputs of the law by which the initial state has set the history variables."""
        x = self._inputs(self._first_e, self._first_e, None, 0.0)
        x[:, self.law.history] = self._given
        return x

    def first_by_given(self, variable: int) -> Array:
        """Derivatives (n, z) of the history variables of the initial state by the given value of
        one."""
        return self.law.by_state(self._inputs_at_first()).history[
            :, self.law.next_history, variable
        ]

    def first_by_number(self, name: str) -> Array:
        """The same by a number of the law."""
        return self.law.by_number(self._inputs_at_first(), name)[:, self.law.next_history]

    def first_products(self, q: Array) -> Array:
        """Derivative (n, D) of the steps by the initial unknowns q (n, D), through the history
        variables that the initial state has set; zero of rows that have moved since."""
        slopes = self.law.by_state(self._inputs_at_first())
        rows = self.law.next_history
        both = slopes.start[:, rows] + slopes.end[:, rows]
        by_first = np.einsum("nz,nzm->nm", self.by_history, both)
        by_first[(self.e0 != self._first_e).any(axis=1)] = 0
        return self._forces_of(by_first, self.at.slope(self.at.vectors(q)))

    def set_number(self, name: str, value: float, rows: slice) -> None:
        """Give a number of the law a value in some rows."""
        self._x[rows, self.law.column(name)] = value
        self._known = None


def _all_or_some(on: Any) -> Any:
    """Indices where it is true (n,); a slice, which copies nothing, where it is true everywhere."""
    if on.all():
        return slice(None)
    return np.flatnonzero(on)


@dataclass(frozen=True, eq=False)
class RowGroup:
    """Terms of one law as one array: a thousand ropes cost little more than one.

    Attributes:
        terms: with consecutive rows of the stencil each, `rows`.
    """

    terms: Sequence[RowsOf[Any]]
    rows: Sequence[slice]
    stencil: Stencil

    def sums(self, values: Array) -> Array:
        """Sums of values (n,) over the rows of each term."""
        return np.bincount(self.stencil.at.owner, values, len(self.terms)).astype(float)


def _group(terms: Sequence[RowsOf[Any]], kind: type[Stencil], system: Assembly) -> RowGroup:
    """Compile terms of one law.  Collective."""
    first = terms[0]
    measures = [term.measure for term in terms]
    at = first.measure.arrays(system.numbering, system.bodies, measures)
    law = LawOfRows(
        first.law,
        at.m,
        first.sizes,
        system.comm,
        variables=len(first.variables),
        driven=tuple(first.driven),
        is_viscous=first.is_viscous,
    )
    numbers = np.zeros((at.n, law.numbers.stop - law.numbers.start))
    history = np.zeros((at.n, law.variables + law.driven_count))
    stencil = kind(at, law, numbers, system.rule, history)
    ends = np.searchsorted(at.owner, np.arange(len(terms) + 1))
    rows = [slice(int(start), int(end)) for start, end in pairwise(ends)]
    for term, of_term in zip(terms, rows, strict=True):
        stencil.numbers[of_term] = term.numbers_here()
        if term.history is None:
            history[of_term] = list(term.variables.values())
        else:
            # From now on they are parts of the arrays of the group.
            history[of_term] = term.history.present
            stencil.before[of_term] = term.history.before
            term.history.present = history[of_term]
            term.history.before = stencil.before[of_term]
    stencil.driven[:] = history[:, law.variables :]
    return RowGroup(terms, rows, stencil)


class RowTerms(Differentiable, CompiledTerms["RowsOf[Any]"]):
    """All rows of one kind of measures of a scene.

    Attributes:
        stencil_type: evaluates the terms of one law.

    Methods without a text here are described in `terms.assembly`.
    """

    has_shape_derivative = True
    stencil_type: ClassVar[type[Stencil]] = Stencil

    def __init__(self, terms: Sequence[RowsOf[Any]], system: Assembly) -> None:
        tuples = [(term.name, term.measure.ports) for term in terms]
        refuse_ports_outside(system.comm, system.bodies, tuples)
        self._system = system
        self._terms = terms
        for term in terms:
            needs_ends = term.driven or term.needs_both_ends
            check_midpoint(term.name, needs_ends and system.rule.takes_mid_strain)
        alike: dict[Any, list[RowsOf[Any]]] = {}
        for term in terms:
            alike.setdefault(term.kind, []).append(term)
        self._groups = [_group(of_kind, self.stencil_type, system) for of_kind in alike.values()]
        self.reversible = not any(group.stencil.has_state for group in self._groups)
        self.losses = [
            term.name for group in self._groups for term in group.terms if term.dissipates
        ]
        indices = [group.stencil.at.indices for group in self._groups]
        self._gather = Gather(system.numbering, indices)
        # Unknowns of the stencils in q1, fetched once in an iteration.
        self._ends: list[Array] | None = None
        # New values of numbers of laws, such as a stiffness, that `set_number` changed after the
        # compilation, by the identity of the term and the name of the number.
        self._numbers: dict[tuple[int, str], float] = {}

    def begin_search(self) -> None:
        for group in self._groups:
            group.stencil.begin_search()

    def begin_step(self, t: float) -> None:
        self._ends = None
        # Driven numbers are those of the end, also where the forces are those of the middle.
        end = self._system.time + self._system.h
        for group in self._groups:
            stencil = group.stencil
            stencil.h = self._system.h
            if stencil.law.driven_count:
                for term, rows in zip(group.terms, group.rows, strict=True):
                    stencil.driven[rows] = [course(end) for course in term.driven.values()]

    def update(self, linearly: bool) -> None:
        self._ends = None

    def inadmissible(self) -> str:
        if not any(term.range for term in self._terms):
            return ""
        problems: list[RowsOf[Any]] = []
        for group, q in self._at_end():
            if group.terms[0].range:
                excess = group.stencil.of_step(q)[:, group.stencil.law.excess]
                problems += [group.terms[i] for i in group.stencil.at.owner[excess >= 0]]
        names = [f"'{term.name}' passes {term.range}" for term in problems]
        first_here = min(names, default="")
        first = min(filter(None, self._system.comm.allgather(first_here)), default="")
        return first and f"{first}, beyond which its moment would jump"

    def _at_end(self) -> Iterator[tuple[RowGroup, Array]]:
        """Each group with its unknowns (n, D) at the end of the step.  Collective."""
        if self._ends is None:
            self._ends = self._gather(self._system.q1)
        return zip(self._groups, self._ends, strict=True)

    def commit(self) -> None:
        self._ends = None
        for group, q in zip(self._groups, self._gather(self._system.q0), strict=True):
            group.stencil.keep(q)

    def add_forces(self, r: PETSc.Vec) -> None:
        for group, q in self._at_end():
            indices = group.stencil.at.indices.ravel()
            forces = group.stencil.force(q).ravel()
            r.setValues(indices, forces, addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def add_tangents(self, A: PETSc.Mat) -> None:
        for group, q in self._at_end():
            group.stencil.add_tangent(A, q)

    def energies(self) -> dict[str, float]:
        found = dict.fromkeys((term.name for term in self._terms if term.stores), 0.0)
        for group in self._groups:
            if group.terms[0].stores:
                shares = group.sums(group.stencil.energy())
                for term, share in zip(group.terms, shares, strict=True):
                    found[term.name] += float(share)
        return found

    def dissipated(self) -> Array:
        found: list[float] = []
        for group, q in self._at_end():
            first = group.terms[0]
            if not first.dissipates:
                continue
            losses = group.sums(group.stencil.of_step(q)[:, group.stencil.law.loss])
            # A damper loses a power, which no pseudo-time multiplies in a search for rest; what
            # yields loses the same, however slowly.
            if self._system.rule.is_static and first.is_viscous:
                losses = np.zeros_like(losses)
            found.extend(losses)
        return np.array(found)

    def supplied(self) -> float:
        total = 0.0
        for group, q in self._at_end():
            if group.terms[0].driven:
                total += float(group.stencil.of_step(q)[:, group.stencil.law.supplied].sum())
        return total

    # ---- sensitivities ---------------------------------------------------------------------------

    def get_number(self, term: RowsOf[Any], key: str) -> Array:
        given = term.variables[key] if key in term.variables else term.numbers[key]
        return np.atleast_1d(self._numbers.get((id(term), key), given))

    def set_number(self, term: RowsOf[Any], key: str, value: Array) -> None:
        group, rows = self._find(term)
        self._numbers[id(term), key] = float(value[0])
        if key in term.variables:
            group.stencil.state[rows, list(term.variables).index(key)] = value[0]
        else:
            group.stencil.set_number(key, float(value[0]), rows)

    def work_by_number(self, term: RowsOf[Any], key: str, w: PETSc.Vec) -> Array:
        """See `Differentiable`; the caller subtracts it.

        Numbers act through the history variables that the step sets, too, and through those of the
        initial state.  The latter is the derivative by these at the start of the first step, which
        is summed up as what it falls in each step, from that at the end of the last one
        (`energy_by_number`).
        """
        group, rows = self._find(term)
        k = self._groups.index(group)
        q = [q for _, q in self._at_end()][k]
        of_rows = self._gather(w)[k]
        stencil = group.stencil
        works = np.zeros(stencil.at.n)
        if key in term.numbers:
            works += np.sum(stencil.force_by_number(q, key) * of_rows, axis=1)
        if term.variables:
            fall = stencil.by_history - stencil.by_history_at_start(q, of_rows)
            works += np.sum(fall * self._first_by(term, key, stencil), axis=1)
            if key in term.numbers:
                by_number = stencil.history_by_number(q, key)
                works -= np.sum(stencil.by_history * by_number, axis=1)
        return np.array([works[rows].sum()])

    def energy_by_number(self, term: RowsOf[Any], key: str) -> Array:
        group, rows = self._find(term)
        stencil = group.stencil
        q = [q for _, q in self._at_end()][self._groups.index(group)]
        energies = np.zeros(stencil.at.n)
        if key in term.numbers:
            energies += stencil.energy_by_number(q, key)
        if term.variables:
            first = self._first_by(term, key, stencil)
            energies += np.sum(stencil.energy_by_history() * first, axis=1)
        return np.array([energies[rows].sum()])

    def _first_by(self, term: RowsOf[Any], key: str, stencil: Stencil) -> Array:
        """Derivatives (n, z) of the history variables of the initial state by a number of the law
        or the given value of a history variable."""
        if key in term.variables:
            return stencil.first_by_given(list(term.variables).index(key))
        return stencil.first_by_number(key)

    def _find(self, term: RowsOf[Any]) -> tuple[RowGroup, slice]:
        """The group of a term, and its rows in it."""
        for group in self._groups:
            for known, rows in zip(group.terms, group.rows, strict=True):
                if known is term:
                    return group, rows
        raise ValueError(f"'{term.name}' is not in this scene")

    def without_gradient(self) -> str:
        # In a run history variables are differentiated, too.
        if not self._system.rule.is_static:
            return ""
        for term in self._terms:
            if term.variables or term.driven:
                return (
                    f"'{term.name}' has a history or a number that is given over time, so that "
                    "its force depends on the path; give it a law without"
                )
        return ""

    def gradient_notes(self) -> list[str]:
        return [
            f"'{term.name}' has a history, which is piecewise smooth: "
            "the gradient is that of what slips in this run"
            for term in self._terms
            if term.variables
        ]

    # ---- a backward pass over the steps of a run -------------------------------------------------

    def exchange_ends(self) -> None:
        self._ends = None
        for group, q in zip(self._groups, self._gather(self._system.q0), strict=True):
            group.stencil.exchange(q)

    def start_adjoint(self) -> None:
        for group in self._groups:
            group.stencil.by_history = np.zeros_like(group.stencil.by_history)

    def add_energy_by_history(self, share: float) -> None:
        for group in self._groups:
            if group.stencil.law.variables:
                by_history = share * group.stencil.energy_by_history()
                group.stencil.by_history = group.stencil.by_history + by_history

    def add_end_derivatives(self, by_position: PETSc.Vec) -> None:
        self._add_products(by_position, Stencil.end_products)

    def add_initial_derivatives(self, by_position: PETSc.Vec) -> None:
        self._add_products(by_position, Stencil.first_products)

    def add_start_derivatives(
        self, μ: PETSc.Vec, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        # The caller subtracts them.
        self._add_products(by_position, Stencil.start_products, sign=-1.0)
        of_rows = self._gather(μ)
        for k, (group, q) in enumerate(self._at_end()):
            if group.stencil.law.variables:
                group.stencil.by_history = group.stencil.by_history_at_start(q, of_rows[k])

    def _add_products(
        self,
        vector: PETSc.Vec,
        products: Callable[[Stencil, Array], Array],
        *,
        sign: float = 1.0,
    ) -> None:
        """Add products (n, D) of each stencil with history variables, a function of its unknowns at
        the end of the step, to a vector.  Collective."""
        for group, q in self._at_end():
            stencil = group.stencil
            if stencil.law.variables:
                values = sign * products(stencil, q).ravel()
                indices = stencil.at.indices.ravel()
                vector.setValues(indices, values, addv=PETSc.InsertMode.ADD_VALUES)
        vector.assemble()


@dataclass(frozen=True, eq=False)
class RowsOf[M: Measure]:
    """Rows of a kind of measures; see `Rows` for the arguments."""

    name: str
    measure: M
    law: RowLaw
    numbers: Mapping[str, float | Array] = field(default_factory=dict)
    parameters: tuple[Parameter, ...] = ()
    variables: Mapping[str, float | Array] = field(default_factory=dict)
    driven: Mapping[str, Callable[[float], float]] = field(default_factory=dict)
    is_viscous: bool = False
    stores: bool = True
    needs_both_ends: bool = False
    range: str = ""
    history: RowHistory | None = field(init=False, default=None)
    compiler: ClassVar[Compiler] = RowTerms

    def __post_init__(self) -> None:
        if self.variables or self.driven:
            history = RowHistory(self.measure.ports, self.variables, self.driven)
            object.__setattr__(self, "history", history)

    @property
    def dissipates(self) -> bool:
        """Whether it may lose energy."""
        return self.is_viscous or bool(self.variables)

    @property
    def sizes(self) -> dict[str, int | None]:
        """The names of the numbers, with None for one number and k for a vector."""
        sizes: dict[str, int | None] = {}
        for name, value in self.numbers.items():
            sizes[name] = np.shape(value)[1] if np.ndim(value) == 2 else None
        return sizes

    @property
    def kind(self) -> Any:
        """Hashable key of the terms that are evaluated as one array."""
        names = (tuple(self.sizes.items()), tuple(self.variables), tuple(self.driven))
        flags = (self.is_viscous, self.stores, self.needs_both_ends, self.range)
        return self.law, names, flags, self.measure.kind

    def numbers_here(self) -> Array:
        """Numbers (n, numbers) of the tuples that this rank evaluates."""
        here = self.measure.here
        count = self.measure.count
        columns: list[Array] = [np.zeros((len(here), 0))]
        for value in self.numbers.values():
            column = np.asarray(value, dtype=float)
            if column.ndim < 2:
                column = np.broadcast_to(column, count)[:, None]
            columns.append(np.broadcast_to(column, (count, column.shape[1]))[here])
        return np.hstack(columns)


class CompiledRows(RowTerms):
    """All `Rows` between ports of a scene."""

    def stresses(
        self, term: Rows, rule: StressRule, *, at_start: bool = False
    ) -> tuple[Array, Array]:
        """Measures (r, m) and stresses (r, m) of a term in the last accepted step by a rule, or at
        its start, of the r tuples of ports that this rank evaluates
        (`point_measures.evaluated_here`).  The measures are those of the configuration in which the
        stresses act.  Collective."""
        of_step, rows, k = self._last_step(term, rule)
        end = self._system.q0
        if at_start:
            of_step.driven[:] = of_step.state[:, of_step.law.variables :]
            end = self._system.previous
        stresses, measures = of_step.stresses(self._gather(end)[k])
        return measures[rows], stresses[rows]

    def stresses_of_step(self, term: Rows) -> Array:
        """Mean stresses (r, m) of a term in the last accepted step, of the r tuples of ports that
        this rank evaluates.  Collective."""
        of_step, rows, k = self._last_step(term, self._system.rule)
        stresses, _ = of_step.stresses(self._gather(self._system.q0)[k])
        # A damper has no force at rest, whatever the last pseudo-step of the search was.
        if term.is_viscous and self._system.rule.is_static:
            stresses = np.zeros_like(stresses)
        return stresses[rows]

    def stress_slopes(self, term: Rows) -> Array:
        """Derivatives (r, m, m) of the stresses of a term at rest by its measures, of the r tuples
        of ports that this rank evaluates.  Collective."""
        group, rows = self._find(term)
        q = self._gather(self._system.q0)[self._groups.index(group)]
        return group.stencil.stress_slopes(q)[rows]

    def stress_by_number(self, term: Rows, key: str) -> Array:
        """Derivatives (r, m) of the stresses of a term at rest by one of its numbers, at given
        measures.  Collective."""
        group, rows = self._find(term)
        q = self._gather(self._system.q0)[self._groups.index(group)]
        return group.stencil.stress_by_number(q, key)[rows]

    def _last_step(self, term: Rows, rule: StressRule) -> tuple[Stencil, slice, int]:
        """The stencil with a term at the start of the last accepted step, the rows of the term, and
        the index of the group.  Collective."""
        group, rows = self._find(term)
        k = self._groups.index(group)
        stencil = group.stencil
        of_step = Stencil(stencil.at, stencil.law, stencil.numbers, rule, stencil.before.copy())
        # Not the length of a step that is tried; after a restart that is not known.
        of_step.h = (self._system.time - self._system.previous_time) or self._system.h
        of_step.driven[:] = stencil.state[:, stencil.law.variables :]
        of_step.start_from(self._gather(self._system.previous)[k])
        return of_step, rows, k

    def variables_of(self, term: Rows) -> Array:
        """History variables and driven numbers (n, z) of all tuples of a term in the accepted
        state, the same on every rank.  Collective."""
        assert term.history is not None
        group, rows = self._find(term)
        present = group.stencil.state
        # In a search they are those of its start, and do not follow its pseudo-steps.
        if self._system.rule.is_static and term.variables:
            present = group.stencil.resting_history(group.stencil.e0)
        return term.history.all_tuples(present[rows])


@dataclass(frozen=True, eq=False)
class Rows(RowsOf[PointMeasure]):
    """What acts between ports by a law of their measures, see the module.

    Args:
        name: of the item.
        measure: m measures of n tuples of ports.
        law: stress, energy and loss of one tuple of ports in a step.  Terms with the same function
            are evaluated together.
        numbers: what the law reads as `numbers.name`: one number, (n,) for one of each tuple, or
            (n, k) or (1, k) for vectors.
        parameters: numbers that have gradients.
        variables: values of history variables at the start, one number or (n,) each; with them each
            rank lists all tuples.
        driven: functions of time [s]; the law reads `numbers.name0` and `numbers.name1` at the ends
            of the step.
        is_viscous: whether stresses depend on the rate: the law gets the strains at both ends with
            every stress rule, and loses nothing in statics.
        stores: whether it has an energy.
        needs_both_ends: whether a rule is refused that takes the strain in the middle of a step.
        range: in words, what a step may not pass, where `Response.excess` becomes positive.

    Example:
        A spring ψ = k e + ½ g e², whose mean stress is that of both ends:

        >>> def hardening(e0, e1, z0, h, numbers):
        ...     k, g = numbers.k, numbers.g
        ...     stress = k + g * (e0[0] + e1[0]) / 2
        ...     return Response([stress], energy=k * e1[0] + g * e1[0] ** 2 / 2)
        >>> a = mass.port()
        >>> b = gx.Ground((0.0, 0.0, 0.0))
        >>> difference = np.hstack([np.eye(3), -np.eye(3)])
        >>> H = (difference.T @ difference)[None]
        >>> measure = PointMeasure([(a, b)], H, np.zeros((1, 6)), np.zeros(1))
        >>> Rows("spring", measure, hardening, {"k": 2.0, "g": 1.0}).name
        'spring'
    """

    compiler: ClassVar[Compiler] = CompiledRows


# ---- kinetic energy of attached vectors ----------------------------------------------------------


class AttachedMasses(Differentiable, CompiledTerms["AttachedKineticEnergy"]):
    """All `AttachedKineticEnergy` terms of a scene."""

    forces_are_forms = True
    has_shape_derivative = True

    def __init__(self, terms: Sequence[AttachedKineticEnergy], system: Assembly) -> None:
        self._terms = terms
        self._system = system
        # New values of numbers, by the identity of the term and the name of the number.
        self._numbers: dict[tuple[int, str], float] = {}

    def mass_of(self, term: AttachedKineticEnergy) -> Array:
        """The masses (n, k, k) of a term with the present values of its numbers."""
        mass = term.mass
        for key, given in term.numbers.items():
            mass = mass * (self._numbers.get((id(term), key), given) / given)
        return mass

    def get_number(self, term: AttachedKineticEnergy, key: str) -> Array:
        return np.atleast_1d(self._numbers.get((id(term), key), term.numbers[key]))

    def set_number(self, term: AttachedKineticEnergy, key: str, value: Array) -> None:
        self._numbers[id(term), key] = float(value[0])

    def work_by_number(self, term: AttachedKineticEnergy, key: str, w: PETSc.Vec) -> Array:
        # Masses are proportional to each of their numbers, and so are loads on them.
        work = 0.0
        for compiled in self._system.compiled:
            if isinstance(compiled, Differentiable):
                work += compiled.work_on_masses(term, w)
        return work / self.get_number(term, key)

    def inertia_by_number(
        self, term: AttachedKineticEnergy, key: str, v: PETSc.Vec, w: PETSc.Vec
    ) -> Array:
        indices, mass = self._matrices(term, np.eye(3))
        gather = Gather(self._system.numbering, [indices])
        # Both gathers are collective.
        [of_w] = gather(w)
        [of_v] = gather(v)
        work = float(np.einsum("nx,nxy,ny->", of_w, mass, of_v))
        return work / self.get_number(term, key)

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
            # Each tuple is added on one rank; the matrix adds up what ranks share.
            indices, of_unknowns = self._matrices(term, each)
            add_blocks(matrix, indices, indices, of_unknowns)

    def _matrices(self, term: AttachedKineticEnergy, each: Array) -> tuple[GlobalIndices, Array]:
        """Global indices (n, D) of the unknowns of the n tuples of a term that this rank evaluates,
        and the matrices (n, D, D) of `_add` by these unknowns."""
        # The attached vectors are P q of unknowns q.
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
        of_vectors = np.einsum("nij,ab->niajb", self.mass_of(term)[own], each)
        mass = of_vectors.reshape(n, rows, rows)
        return indices, np.einsum("nax,nab,nby->nxy", P, mass, P, optimize=True)


@dataclass(frozen=True, eq=False)
class AttachedKineticEnergy:
    """Kinetic energy ½ Σ_ij mass[i, j] v_i·v_j of the rates v of attached vectors.

    Args:
        ports: n tuples of k ports, as those of a `PointMeasure`.
        mass: (n, k, k) [kg] for points; kg m and kg m² where directors take part.
        numbers: by which all of the masses are multiplied, by name, none zero, e.g. a line density.
        parameters: of these numbers, those by which results can be derived.
    """

    ports: Sequence[tuple[Port, ...]]
    mass: Array
    numbers: Mapping[str, float] = field(default_factory=dict)
    parameters: tuple[Parameter, ...] = ()
    compiler: ClassVar[Compiler] = AttachedMasses
