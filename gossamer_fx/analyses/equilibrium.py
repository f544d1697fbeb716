"""Static equilibrium, also of films that wrinkle, from a start that need not be near.

Pseudo-transient continuation (Kelley & Keyes, SIAM J. Numer. Anal. 35 (1998) 508, doi:10.1137/S0036142996304796):
backward Euler steps from rest, with stress and loads at the end of the step,

    M (q1 - q0)/h² + De(q1)ᵀψ'(e(q1)) = F(q1),

the mass as the only regularisation.  Every pseudo-step is solved by the mixed Newton iteration of
`discrete_gradient`; h grows when few iterations sufficed and is cut when it failed, so that the equation turns into
that of equilibrium.  The end is a Newton iteration with no inertia at all.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np
from petsc4py import PETSc

from gossamer_fx.checks.errors import NoEquilibrium, check
from gossamer_fx.interactions.fixed import Fixed, Prescribed
from gossamer_fx.model.terms import Array
from gossamer_fx.scene.scene import Scene
from gossamer_fx.solvers.newton import Newton, NotConverged, Tolerances
from gossamer_fx.system.system import System
from gossamer_fx.system.totals import Totals
from gossamer_fx.terms.discrete_gradient import EndPoint

MOTIONS = ("translation x", "translation y", "translation z", "rotation x", "rotation y", "rotation z")


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

    residual: float = 1e-8
    step: float = 2e-3
    growth: float = 1.6
    fast_iterations: int = 12
    cut: float = 0.5
    cap_growth: float = 1.1
    inner: float = 0.1
    max_iterations: int = 25
    iterations: int = 1000

    def __post_init__(self) -> None:
        for name in ("residual", "step", "inner"):
            value = getattr(self, name)
            check(math.isfinite(value) and value > 0, f"Continuation: {name} is {value!r}; give a positive number.")
        check(self.growth > 1, f"Continuation: growth is {self.growth!r}; the step can only grow by a factor above 1.")
        check(0 < self.cut < 1, f"Continuation: cut is {self.cut!r}; give a factor between 0 and 1.")


@dataclass(frozen=True)
class EquilibriumResult:
    """An equilibrium.

    residual    unbalanced force over that of loads and supports
    iterations  Newton iterations, those of failed pseudo-steps included
    steps, cuts pseudo-steps, and failed ones among them
    seconds     CPU time of this rank, without compilation
    totals      energies; the kinetic energy is zero, `supplied` is the work of loads and supports along the path of
                the continuation (exact for dead loads and prescribed pressure)
    regular     whether Newton's iteration converges without inertia: then the tangent is not singular
    free        rigid motions that no support or load resists: the equilibrium is unique up to them at best
    """

    residual: float
    iterations: int
    steps: int
    cuts: int
    seconds: float
    totals: Totals
    regular: bool
    free: tuple[str, ...]


class Equilibrium:
    """Finds the static equilibrium of a scene; its state is then in `system` (`q0`), for `fields` and `modes`.

    Args:
        scene: what there is; its initial state is the first guess, its initial velocities are ignored.
        search: how to look for it.

    Openings between chambers flow, and damping resists, in the pseudo-time of the continuation; at equilibrium they
    have come to rest.
    """

    def __init__(self, scene: Scene, search: Continuation = Continuation()) -> None:
        started = time.perf_counter()
        self.scene, self.search, self.comm = scene, search, scene.comm
        self.system: System = scene.compile(EndPoint())
        self.newton = Newton(self.system, Tolerances(), direct=True)
        self._rest, self._r = self.system.numbering.vector(), self.system.numbering.vector()
        self.compile_seconds = time.perf_counter() - started

    def find(self, at: float = 0.0) -> EquilibriumResult:
        """Equilibrium under the loads and prescribed positions of time `at` [s], from the present state.

        Increments of load are several calls, with loads that are functions of time.

        Raises:
            NoEquilibrium: with the residual that was reached, the reason and the place.
        """
        started = time.process_time()
        self._spent = self._steps = self._cuts = 0
        self._continue(at)
        free = self._free_motions()
        regular = not free and self._finish(at)
        residual, _ = self._unbalanced()
        seconds = time.process_time() - started
        return EquilibriumResult(
            residual, self._spent, self._steps, self._cuts, seconds, self.system.totals(), regular, free
        )

    def reaction(
        self, support: Fixed | Prescribed, about: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> tuple[Array, Array]:
        """Force [N] and moment [N m] about a point that a support exerts, (3,) each, in the equilibrium found last."""
        system = self.system
        k = system.bodies.index(support.body)
        owned = system.numbering.owned(k)
        forces = system.outside().array_r[owned].reshape(-1, 3)
        nodes = support.body.nodes(support.group)
        nodes = nodes[nodes < len(forces)]
        held = np.zeros_like(forces)
        these = np.ix_(nodes, np.array(support.components))
        held[these] = forces[these]
        arms = system.q0.array_r[owned].reshape(-1, 3) - np.asarray(about)
        total: Array = self.comm.allreduce(np.array([held.sum(axis=0), np.cross(arms, held).sum(axis=0)]))
        return total[0], total[1]

    def _continue(self, at: float) -> None:
        """Pseudo-steps until the residual is small without inertia."""
        search, h = self.search, self.search.step
        inner = Tolerances(search.inner, border=1e-8, constraint=1e-8, iterations=search.max_iterations)
        residual, round_off, ceiling, why = math.inf, 0.0, math.inf, "no step succeeded"
        while residual > max(search.residual, round_off):
            try:
                used = self._step(h, at, inner)
            except NotConverged as failure:
                ceiling, h = h * math.sqrt(search.cut), h * search.cut
                self._cuts += 1
                why = str(failure)
            else:
                residual, load = self._unbalanced()
                round_off = self.newton.round_off / load if load > 0 else 0.0
                inner = replace(inner, absolute=search.residual * load / 2)
                ceiling *= search.cap_growth ** (3 if used <= search.fast_iterations // 3 else 1)
                if used <= search.fast_iterations:
                    h = min(h * search.growth, ceiling, 1e9 * search.step)
            if max(self._spent, self._steps) > search.iterations or h < 1e-6 * search.step:
                raise NoEquilibrium(
                    f"No equilibrium after {self._spent} Newton iterations in {self._steps} pseudo-steps: the "
                    f"unbalanced force is {residual:.1e} of the load, pseudo-step {h:.1e} s, largest in "
                    f"{self.system.place(self._r)}; last failure: {why}."
                )

    def _finish(self, at: float) -> bool:
        """Newton's iteration without inertia; whether it converges to a residual a hundred times smaller."""
        residual, load = self._unbalanced()
        target = 1e-2 * min(residual, self.search.residual) * load
        try:
            self._step(math.inf, at, Tolerances(0.0, target, border=1e-10, iterations=10))
        except NotConverged:
            return False
        return True

    def _step(self, h: float, at: float, tolerances: Tolerances) -> int:
        """One pseudo-step under the loads of time `at`; returns the iterations."""
        system = self.system
        passing = h if math.isfinite(h) else self.search.step / 1e-6
        system.time = at - passing
        y = system.begin(passing)
        system.inertia(1 / h**2)
        self.newton.tolerances = tolerances
        self._steps += 1
        try:
            _, self._y, used = self.newton.solve(self._rest, y)
        finally:
            self._spent += self.newton.iterations
            system.time = at
        system.accept(self._rest)
        system.time = at
        return used

    def _unbalanced(self) -> tuple[float, float]:
        """Residual without inertia over the outer forces, and those forces [N], at the accepted state."""
        system = self.system
        system.inertia(0.0)
        system.residual(self._y, self._r)
        load = float(system.outside().norm())
        unbalanced, _ = system.imbalance(self._r)
        return (unbalanced / load if load > 0 else unbalanced), load

    def _free_motions(self) -> tuple[str, ...]:
        """Rigid motions of the whole scene whose stiffness is what is left of the residual, or round-off."""
        system = self.system
        system.inertia(0.0)
        unbalanced, load = self._unbalanced()
        left = 2 * unbalanced * (load or 1.0)
        K = system.tangent()
        stiffness, out = K.getDiagonal().norm(PETSc.NormType.NORM_INFINITY), self._rest.duplicate()
        free = []
        for name, φ in zip(MOTIONS, rigid_motions(system), strict=True):
            K.mult(φ, out)
            if φ.norm() > 0 and out.norm() < left + 1e-13 * stiffness * φ.norm():
                free.append(name)
        return tuple(free)


def rigid_motions(system: System) -> list[PETSc.Vec]:
    """Velocities of the coordinates in three translations and three rotations about the origin, zero where held."""
    motions = []
    for i, axis in enumerate([*np.eye(3), *np.eye(3)]):
        φ = system.numbering.vector()
        with φ as values:
            for k, body in enumerate(system.bodies):
                owned = system.numbering.owned(k)
                q = system.q0.array_r[owned].reshape(-1, 3)
                v = np.cross(axis, q) if i >= 3 else np.zeros_like(q)
                if i < 3:
                    v[:: body.block.size // 3] = axis
                values[owned] = v.ravel()
            values[system.supports.held] = 0
        motions.append(φ)
    return motions


Found = EquilibriumResult  # its former name
