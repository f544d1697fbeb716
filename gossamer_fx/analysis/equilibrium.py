"""Static equilibrium, also of films that wrinkle, from a start that need not be near.

Pseudo-transient continuation (Kelley & Keyes, SIAM J. Numer. Anal. 35 (1998) 508, doi:10.1137/S0036142996304796):
backward Euler steps from rest, with stress and loads at the end of the step,

    M (q1 - q0)/h² + De(q1)ᵀψ'(e(q1)) = F(q1),

the mass as the only regularisation.  Every pseudo-step is solved by the mixed Newton iteration of
`discrete_gradient`; h grows when few iterations sufficed and is cut when it failed, so that the equation turns into
that of equilibrium.  The end is a Newton iteration with no inertia at all.

A plate (or any film that can push) that wrinkles has an indefinite tangent until its wrinkles are nearly those at
rest.  So a pseudo-step that fails is tried again with the geometric stiffness of tension alone, which bounds the energy
from above: slow, but each such step gets down.  Where that helps, the next steps begin like that too.
"""

from __future__ import annotations

import math
import time
from dataclasses import KW_ONLY, dataclass, replace
from numbers import Real
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.rigid_motions import free_motions
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import NoEquilibrium, check
from gossamer_fx.model.body import Array
from gossamer_fx.scene.scene import Scene
from gossamer_fx.solvers import factorisation
from gossamer_fx.solvers.failures import NotConverged
from gossamer_fx.solvers.newton import Newton
from gossamer_fx.solvers.tolerances import Tolerances
from gossamer_fx.system.reactions import Joint, NamedPart, joint_force, support_force
from gossamer_fx.system.system import System
from gossamer_fx.system.totals import Totals
from gossamer_fx.terms.discrete_gradient import EndPoint
from gossamer_fx.terms.element_energies import StoredEnergy

FAR = 1e3  # sizes of the scene beyond which a body has flown off
ROUNDED = 1e-3  # largest round-off of the forces, over the load, that may stand for balance
CAREFUL = 10**6  # tangents of a careful step without geometric stiffness but that of tension: all
PATIENCE = 16  # pseudo-steps, at most, for which care is taken, or not tried


@check_arguments
@dataclass(frozen=True)
class Continuation:
    """How an equilibrium is approached.

    residual    unbalanced force over that of loads and supports (Euclidean norms) at which equilibrium is reached;
                forces in a slender beam or cable may be known to fewer digits, and their round-off is enough then
    step        first pseudo-step [s]; about the time in which the load moves the film by its own size
    growth      factor of the pseudo-step after at most `fast_iterations` iterations
    cut         factor of the pseudo-step after a failure
    cap_growth  growth per step of the ceiling that a failure leaves, below the pseudo-step that failed; its third power
                after a step of at most `fast_iterations`/3 iterations
    inner       relative residual to which a pseudo-step is solved
    max_iterations  Newton iterations after which a pseudo-step has failed
    iterations  Newton iterations in all after which the search is given up
    """

    _: KW_ONLY
    tolerance: float = 1e-8
    first_step: float = 2e-3
    growth_factor: float = 1.6
    fast_iterations: int = 12
    cut_factor: float = 0.5
    cap_growth: float = 1.1
    inner_tolerance: float = 0.1
    max_iterations: int = 25
    total_iterations: int = 1000

    def __post_init__(self) -> None:
        for name in ("tolerance", "first_step", "inner_tolerance"):
            value = getattr(self, name)
            check(
                math.isfinite(value) and value > 0,
                f"Continuation: {name} is {value!r}; give a positive number.",
            )
        for name in ("tolerance", "inner_tolerance"):
            value = getattr(self, name)
            check(
                value < 1,
                f"Continuation: {name} is {value!r}, which any state meets; give a number below 1.",
            )
        check(
            self.growth_factor > 1,
            f"Continuation: growth_factor is {self.growth_factor!r}; the step can only grow by a factor above 1.",
        )
        check(
            0 < self.cut_factor < 1,
            f"Continuation: cut_factor is {self.cut_factor!r}; give a factor between 0 and 1.",
        )


@check_arguments
@dataclass(frozen=True)
class EquilibriumResult:
    """An equilibrium.

    residual    unbalanced force over that of loads and supports, or where there are none, over a thousand times the
                round-off of the inner forces
    iterations  Newton iterations, those of failed pseudo-steps included
    steps, cuts pseudo-steps, and failed ones among them
    seconds     CPU time of this rank, without compilation
    totals      energies; the kinetic energy is zero, `supplied` is the work of loads and supports along the path of
                the continuation (exact for dead loads and prescribed pressure)
    regular     whether Newton's iteration converges without inertia, and the tangent is not singular
    free        rigid motions that no support or load resists, of each part that moves by itself: the equilibrium is
                unique up to them at best
    """

    residual: float
    iterations: int
    steps: int
    cuts: int
    seconds: float
    totals: Totals
    regular: bool
    free: tuple[str, ...]


@check_arguments
class Equilibrium:
    """Finds the static equilibrium of a scene; its state is then in `system` (`q0`), for `fields` and `modes`.

    Args:
        scene: what there is; its initial state is the first guess, its initial velocities are ignored.
        search: how to look for it.

    Openings between chambers flow, and damping resists, in the pseudo-time of the continuation; at equilibrium they
    have come to rest.
    """

    def __init__(self, scene: Scene, search: Continuation = Continuation()) -> None:
        check(
            bool(scene.bodies),
            "Equilibrium: the scene has no body to move; add a film, cable, beam or mass.",
        )
        started = time.perf_counter()
        self.scene, self.search, self.comm = scene, search, scene.comm
        self.system: System = scene.compile(EndPoint())
        self.newton = Newton(self.system, Tolerances(), direct=True)
        self._rest, self._r, self._begun = (self.system.numbering.vector() for _ in range(3))
        self._size = self._extent()
        self._pushes = any(
            isinstance(term, StoredEnergy) and term.pulling for term in self.system.terms
        )
        self.result: EquilibriumResult | None = None
        self.compile_seconds = time.perf_counter() - started

    def find(self, at: float = 0.0) -> EquilibriumResult:
        """Equilibrium under the loads and prescribed positions of time `at` [s], from the present state.

        Increments of load are several calls, with loads that are functions of time.

        Raises:
            NoEquilibrium: with the residual that was reached, the reason and the place.
        """
        started = time.process_time()
        check(
            isinstance(at, Real) and math.isfinite(at),
            f"find: at is {at!r}; give a time in seconds.",
        )
        self._spent = self._steps = self._cuts = 0
        self.result = None
        self.system.q0.copy(self._begun)
        self._continue(at)
        free, regular = self._judge(at)
        residual, _ = self._unbalanced()
        seconds = time.process_time() - started
        self.result = EquilibriumResult(
            residual,
            self._spent,
            steps=self._steps,
            cuts=self._cuts,
            seconds=seconds,
            totals=self.system.totals(),
            regular=regular,
            free=free,
        )
        return self.result

    # ---- the result ---------------------------------------------------------------------------------------------

    def reaction(
        self, support: NamedPart, about: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> tuple[Array, Array]:
        """Force [N] and moment [N m] about a point that a support exerts, (3,) each, in the equilibrium found last.

        Raises:
            InputError: no equilibrium was found yet, or the support is not in the scene.
        """
        self.need("reaction")
        return support_force(self.system, support, about)

    def joint_force(
        self, joint: Joint, about: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> tuple[Array, Array]:
        """Force [N] and moment [N m] about a point that a joint exerts on its side `b`, (3,) each.

        Raises:
            InputError: no equilibrium was found yet, or the joint is not in the scene.
        """
        self.need("joint_force")
        return joint_force(self.system, joint, about)

    def need(self, what: str) -> None:
        """Raise `InputError` unless an equilibrium was found."""
        check(
            self.result is not None,
            f"{what}: no equilibrium was found yet; call find() of the Equilibrium first.",
        )

    @property
    def time(self) -> float:
        """[s], of the loads."""
        return self.system.time

    @property
    def totals(self) -> Totals:
        """Energies and momenta now."""
        return self.system.totals()

    @property
    def chambers(self) -> dict[str, Any]:
        """States of the gas chambers and tanks by name."""
        return {
            name: state
            for border in self.system.scalar_unknowns
            for name, state in border.states().items()
        }

    def chamber(self, name: str) -> Any:
        """State of the gas in one chamber, see `gas.state.ChamberState`."""
        chambers = self.chambers
        known = ", ".join(chambers) or "none"
        check(
            name in chambers,
            f"The scene has no chamber '{name}'; its chambers and tanks are: {known}.",
        )
        return chambers[name]

    # ---- the search ---------------------------------------------------------------------------------------------

    def _continue(self, at: float) -> None:
        """Pseudo-steps until the residual is small without inertia."""
        search, h = self.search, self.search.first_step
        inner = Tolerances(
            search.inner_tolerance,
            scalars=1e-8,
            constraint=1e-8,
            max_iterations=search.max_iterations,
        )
        residual, round_off, ceiling, why = math.inf, 0.0, math.inf, "no step succeeded"
        care = _Care(self._pushes)
        while residual > max(search.tolerance, min(round_off, ROUNDED)):
            self.newton.geometric_stiffness_delay = CAREFUL if care.taken else 0
            try:
                used = self._step(h, at, inner)
            except NotConverged as failure:
                self._cuts += 1
                why = str(failure)
                if not care.fail():
                    ceiling, h = h * math.sqrt(search.cut_factor), h * search.cut_factor
            else:
                care.succeed()
                self._stay()
                residual, load = self._unbalanced()
                round_off = self.newton.round_off / load
                inner = replace(inner, absolute=search.tolerance * load / 2)
                ceiling *= search.cap_growth ** (3 if used <= search.fast_iterations // 3 else 1)
                if used <= search.fast_iterations:
                    h = min(h * search.growth_factor, ceiling, 1e9 * search.first_step)
            if (
                max(self._spent, self._steps) > search.total_iterations
                or h < 1e-6 * search.first_step
            ):
                raise NoEquilibrium(
                    f"No equilibrium after {self._spent} Newton iterations in {self._steps} pseudo-steps: the "
                    f"unbalanced force is {residual:.1e} of the load, pseudo-step {h:.1e} s, largest in "
                    f"{self.system.locate(self._r)}; last failure: {why}."
                )

    def _finish(self, at: float) -> bool:
        """Newton's iteration without inertia; whether it converges to a residual a hundred times smaller."""
        self.newton.geometric_stiffness_delay = 0
        residual, load = self._unbalanced()
        target = 1e-2 * min(residual, self.search.tolerance) * load
        try:
            self._step(math.inf, at, Tolerances(0.0, target, scalars=1e-10, max_iterations=10))
        except NotConverged:
            return False
        return True

    def _step(self, h: float, at: float, tolerances: Tolerances) -> int:
        """One pseudo-step under the loads of time `at`; returns the iterations."""
        system = self.system
        passing = h if math.isfinite(h) else self.search.first_step / 1e-6
        system.time = at - passing
        y = system.begin_step(passing)
        system.set_inertia(1 / h**2)
        self.newton.tolerances = tolerances
        self._steps += 1
        try:
            _, self._y, used = self.newton.solve(self._rest, y)
        except NotConverged:
            system.set_end(system.q0)
            raise
        finally:
            self._spent += self.newton.iterations
            system.time = at
        system.commit(self._rest)
        system.time = at
        return used

    def _unbalanced(self) -> tuple[float, float]:
        """Residual without inertia over the outer forces, and those forces [N], at the accepted state.

        Where these are less than a thousand times the round-off of the inner forces, that stands for them.
        """
        system = self.system
        system.set_inertia(0.0)
        system.residual(self._y, self._r)
        load = max(float(system.external_forces().norm()), self.newton.round_off / ROUNDED, 1e-300)
        unbalanced, _ = system.imbalance(self._r)
        return unbalanced / load, load

    def _extent(self) -> float:
        """Size of the scene and its distance from the origin [m]."""
        largest = max(
            (float(np.abs(b.initial_state()[0]).max(initial=0.0)) for b in self.system.bodies),
            default=0.0,
        )
        return max(self.comm.allreduce(largest, op=MPI.MAX), 1e-3)

    def _judge(self, at: float) -> tuple[tuple[str, ...], bool]:
        """Rigid motions that nothing resists, and whether the tangent without inertia is regular."""
        finished = self._finish(at)
        system = self.system
        unbalanced, load = self._unbalanced()
        K = system.tangent()
        free = free_motions(system, K, unbalanced * (load or 1.0))
        return free, not free and finished and (
            bool(system.scalar_unknowns) or not factorisation.is_singular(K)
        )

    def _stay(self) -> None:
        """See that the scene did not fly off: what nothing holds moves the further the longer the pseudo-step."""
        system = self.system
        Δ = np.abs(system.q0.array_r - self._begun.array_r)
        far = np.array([Δ[system.block(body).owned].max(initial=0.0) for body in system.bodies])
        system.comm.Allreduce(MPI.IN_PLACE, far, op=MPI.MAX)
        k = int(far.argmax())
        if far[k] > FAR * self._size:
            raise NoEquilibrium(
                f"No equilibrium: '{system.bodies[k].name}' has moved by {far[k]:.1e} m and moves on; hold it, or let "
                "the loads on it balance each other."
            )


class _Care:
    """Whether pseudo-steps leave out the geometric stiffness of what pushes."""

    def __init__(self, possible: bool) -> None:
        self._possible, self.taken = possible, False
        self._helped = 0  # failures without care after which care succeeded
        self._left = 0  # steps until it is changed again

    def fail(self) -> bool:
        """After a step that failed: whether it is worth to try it again as it is."""
        if self.taken:
            if not self._helped:  # then it is of no use for a while
                self.taken, self._left = False, PATIENCE
            return False
        if not self._possible or (self._left and not self._helped):
            return False
        self.taken, self._left = True, min(2**self._helped, PATIENCE)
        return True

    def succeed(self) -> None:
        self._left = max(self._left - 1, 0)
        if self.taken:
            self._helped += self._left == 0
            self.taken = self._left > 0
