"""Static equilibrium, also of films that wrinkle, from a first guess that need not be near.

Problem.  Without inertia the tangent of slack or wrinkled film is singular or indefinite, and
Newton's iteration for De(q)ᵀψ'(e(q)) = F(q) converges only from a state close to the solution.

Idea.  Pseudo-transient continuation (Kelley & Keyes, SIAM J. Numer. Anal. 35 (1998) 508,
doi:10.1137/S0036142996304796): backward Euler steps from rest, with stress and loads at their end,

    M (q1 - q0)/h² + De(q1)ᵀψ'(e(q1)) = F(q1)                                                 (1)

The mass is the only regularisation.  With growing pseudo-steps h, (1) becomes the equation of
equilibrium.

Algorithm.

1. Solve (1) by Newton's iteration (`solvers.newton`) to the relative tolerance `inner_tolerance`.
2. If it fails, shorten h, and let a ceiling for h grow slowly from below the step that failed.  If
   it took few iterations, let h grow up to the ceiling.
3. Repeat until the unbalanced force without inertia is `tolerance` times the external force.
4. Solve once more without inertia, to see whether the tangent is regular.

A plate, or any film that resists compression, has an indefinite tangent until its wrinkles are
nearly those at rest.  Therefore a pseudo-step that fails is repeated with the geometric stiffness
of tension only.  This tangent bounds that of the energy from above, so that the iteration is slow
but goes down in energy.  If it helps, the following pseudo-steps use it from the start
(`_TensionOnly`).

Cost.  A spinning film takes 5 pseudo-steps of one iteration each, a clamped plate under pressure 15
with 36 iterations in all; plates that wrinkle take many more.

Progress.  A search of more than three seconds writes lines on the standard error
(`search_progress`). SIGINT (Ctrl-C) and SIGTERM end it after the present pseudo-step, whose state
is then that of the system.

Limits.  The path passes through states that are not in equilibrium, so that of several equilibria
the one that is found depends on the first guess and on the pseudo-steps.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Mapping
from dataclasses import KW_ONLY, asdict, dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.design.search_progress import SearchProgress, SearchState
from gossamer_fx.analysis.statics.prestress import (
    MAX_NAMED_PARTS,
    PrestressOfScene,
    ReachedPrestress,
    lost_prestress_words,
)
from gossamer_fx.analysis.statics.remedies import (
    PressedFilm,
    collapsing_pressures,
    measure_pressed_films,
    remedies,
)
from gossamer_fx.analysis.vibration.rigid_motions import free_motions, listed
from gossamer_fx.core.checks.arguments import Range, check_arguments, positive
from gossamer_fx.core.checks.errors import NoEquilibrium, NotConverged, check
from gossamer_fx.core.checks.interruption import Interrupted, Listener
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.terms.discrete_gradient import AtRest
from gossamer_fx.mechanics.terms.element_energies import StoredEnergy
from gossamer_fx.records.fields.reactions import Joint, NamedPart, joint_force, support_force
from gossamer_fx.solve.scene.scene import Scene
from gossamer_fx.solve.solvers import factorisation
from gossamer_fx.solve.solvers.convergence import Tolerances
from gossamer_fx.solve.solvers.newton import Newton
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.system.totals import Totals
from gossamer_fx.solve.view import LOAD_PARAMETER, Account

# What stays constant in the chambers, see `gas.static_processes`.
GasProcess = Literal["adiabatic", "isothermal", "held pressure"]

# Displacement of a body over the size of the scene beyond which it is not held: without supports it
# moves farther with every pseudo-step.
MAX_RELATIVE_DISPLACEMENT = 1e3

# Size of the scene [m] that is assumed if all coordinates are smaller.
MIN_SCENE_SIZE = 1e-3

# External force over the largest one of earlier searches, up to which it counts as zero: after
# unloading the inner forces have round-off and no load to be compared with.
VANISHING_LOAD = 1e-6

# Largest round-off of the inner forces, over the load, that may count as equilibrium.  In a slender
# beam or cable the forces are known to fewer digits than `Continuation.tolerance`.
MAX_ROUND_OFF = 1e-3

# Tangents at the start of a pseudo-step with the geometric stiffness of tension only: all of them.
ALL_TANGENTS = 10**6

# Largest number of pseudo-steps for which the geometric stiffness of tension only is used, or not
# tried.
MAX_DELAY_STEPS = 16

# Pseudo-steps over the first one.  Above the largest the inertia is round-off; below the smallest
# the continuation has failed.
MAX_STEP_RATIO = 1e9
MIN_STEP_RATIO = 1e-6

# Tolerance of the equations of scalar unknowns and of constraints in a pseudo-step, and at the end.
INNER_TOLERANCE = 1e-8
FINAL_TOLERANCE = 1e-10

# The residual that Newton's iteration without inertia must reach, over that of the equilibrium, and
# the number of iterations that it has: a regular tangent needs two or three.
FINAL_REDUCTION = 1e-2
FINAL_ITERATIONS = 10

# Smallest load [N]: against division by zero, and so that a tolerance times it is still a number of
# a size that `Tolerances` accepts.
TINY = 1e-80

# Loads over the estimated round-off of the inner forces, below which the equilibrium may not show
# them.  Cantilevers of thin plates were right down to 6e-6, and had not moved at 5e-6 and less.
LOST_LOAD = 1e-4

LOG = logging.getLogger("gossamer_fx")


@check_arguments
@dataclass(frozen=True)
class Continuation:
    """How an equilibrium is approached; see the module for the algorithm.

    Args:
        tolerance: unbalanced force over that of loads and supports (Euclidean norms) at which
            equilibrium is reached.  The forces in a slender beam or cable may be known to fewer
            digits; their round-off is then enough.
        first_step: first pseudo-step [s]; about the time in which the load moves the film by its
            own size.
        growth_factor: factor of the pseudo-step after at most `fast_iterations` iterations.
        fast_iterations: Newton iterations up to which a pseudo-step grows.
        cut_factor: factor of the pseudo-step after a failure.
        cap_growth: growth per step of the ceiling that a failure leaves, below the pseudo-step that
            failed; its third power after a step of at most `fast_iterations`/3 iterations.
        inner_tolerance: relative residual to which a pseudo-step is solved.
        max_iterations: Newton iterations after which a pseudo-step has failed.
        total_iterations: Newton iterations in all after which the search is given up.

    Raises:
        InputError: a value is out of its range.

    Example:
        >>> gx.analysis.Continuation(first_step=1e-2).growth_factor
        1.6
    """

    _: KW_ONLY
    tolerance: Annotated[float, positive()] = 1e-8
    first_step: Annotated[float, positive("s")] = 2e-3
    growth_factor: Annotated[float, Range(1.0, above=True)] = 1.6
    fast_iterations: Annotated[int, positive()] = 12
    cut_factor: Annotated[float, positive()] = 0.5
    cap_growth: Annotated[float, positive()] = 1.1
    inner_tolerance: Annotated[float, positive()] = 0.1
    max_iterations: Annotated[int, positive()] = 25
    total_iterations: Annotated[int, positive()] = 1000

    def __post_init__(self) -> None:
        # With a tolerance of 1 or more, the first guess would already be an equilibrium.
        for name in ("tolerance", "inner_tolerance", "cut_factor"):
            value = getattr(self, name)
            check(value < 1, f"Continuation: {name} is {value!r}; give a number below 1.")


@check_arguments
@dataclass(frozen=True, repr=False)
class EquilibriumResult:
    """An equilibrium and how it was found.

    Attributes:
        residual: unbalanced force over that of loads and supports; where there are none, over a
            thousand times the round-off of the inner forces.
        iterations: Newton iterations, including those of failed pseudo-steps.
        steps: pseudo-steps, including failed ones.
        cuts: failed pseudo-steps.
        seconds: CPU time of this rank [s], without compilation.
        totals: energies.  The kinetic energy is zero; `supplied` is the work of loads and supports
            along the path of the continuation, which is exact for dead loads and prescribed
            pressure.
        regular: whether Newton's iteration converges without inertia and the tangent is not
            singular.
        free: rigid motions that no support or load resists, of each part that moves independently;
            the equilibrium is unique at most up to these.
        within_tolerance: whether the residual reached the tolerance of the search.  Otherwise
            round-off of the inner forces has ended it earlier.
        prestress: of the films, cables and beams that have one, by their names: which stress or
            tension was asked for, and which is left.

    An equilibrium that is not regular, not within its tolerance, or in which a part has less than
    90 % of its prestress, is also reported by a warning in the log.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> result = gx.Equilibrium(gx.Scene(weight, spring)).find()
        >>> result.free
        ()
        >>> result.residual < 1e-8
        True
    """

    residual: float
    iterations: int
    steps: int
    cuts: int
    seconds: float
    totals: Totals
    regular: bool
    free: tuple[str, ...]
    within_tolerance: bool = True
    prestress: Mapping[str, ReachedPrestress] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Residual, iterations and time, and what falls short."""
        words = [
            f"residual {self.residual:.1e}",
            f"{self.iterations} iterations",
            f"{self.seconds:.2g} s",
        ]
        if not self.within_tolerance:
            words.append("not within its tolerance")
        if self.free:
            words.append(f"nothing resists {listed(self.free)}")
        elif not self.regular:
            words.append("not unique")
        named = sorted(self.prestress.items(), key=lambda item: item[1].ratio)
        if len(named) > MAX_NAMED_PARTS:
            # Of many parts the one that has lost most.
            named = named[:1]
        words += [f"prestress of '{name}' {reached.short()}" for name, reached in named]
        return f"<EquilibriumResult: {', '.join(words)}>"


@check_arguments
class Equilibrium:
    """Finds the static equilibrium of a scene; its state is then in `system`, for `fields` and
    `modes`.

    Openings between chambers flow and damping resists in the pseudo-time of the continuation; at
    equilibrium both have ceased.  The gas of a closed chamber changes from its initial state by the
    process `gas`: "adiabatic" as in a run, so that it cools while a film unfolds; "isothermal", its
    temperature is constant; "held pressure", a blower holds its pressure.

    Args:
        scene: its initial state is the first guess; its initial velocities are ignored.
        search: how to look for the equilibrium.
        gas: process of the gas in all chambers.

    Attributes:
        axis: what `find` calls `at`, for records, see `outputs.record`.
        step: number of searches that were made.
        result: of the last `find`; None if it failed or was not called.
        compile_seconds: wall time of the compilation [s].

    Raises:
        InputError: the scene has no body.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> equilibrium = gx.Equilibrium(gx.Scene(weight, spring))
        >>> equilibrium.find().regular
        True
    """

    def __init__(
        self, scene: Scene, search: Continuation = Continuation(), *, gas: GasProcess = "adiabatic"
    ) -> None:
        check(
            bool(scene.bodies),
            "Equilibrium: the scene has no body to move; add a film, cable, beam or mass.",
        )
        started = time.perf_counter()
        self.scene = scene
        self.search = search
        self.comm = scene.comm
        self.system: System = scene.compile(AtRest())
        for scalars in self.system.scalar_unknowns:
            scalars.set_static_process(gas)
        self.newton = Newton(self.system, Tolerances(), direct=True)
        numbering = self.system.numbering
        self._zero = numbering.vector()  # increment predicted, and velocity after a step
        self._residual = numbering.vector()
        self._start = numbering.vector()  # coordinates at the start of `find`
        self._scene_size = self._measure_scene()
        self._resists_compression = any(
            isinstance(term, StoredEnergy) and term.pulling for term in self.system.terms
        )
        self._prestress = PrestressOfScene(self.system)
        self.axis = LOAD_PARAMETER
        self.step = 0
        self._all_iterations = 0  # of all searches
        self._all_seconds = 0.0  # CPU time [s] of all searches
        # Norm of the external forces, of all equilibria found so far [N]
        self._largest_load = 0.0
        self.result: EquilibriumResult | None = None
        self.compile_seconds = time.perf_counter() - started

    @check_arguments
    def find(self, at: float = 0.0, *, progress: bool = True) -> EquilibriumResult:
        """Find the equilibrium under the loads and prescribed positions of a time, from the present
        state.

        For increments of load call it several times, with loads that are functions of time.

        Args:
            at: time of loads and prescribed positions [s].
            progress: whether a search of more than three seconds writes lines on the standard
                error.

        Raises:
            InputError: `at` is not a finite number.
            NoEquilibrium: with the residual that was reached, the reason, where it is largest, and
                what may help.
            Interrupted: a signal came; the system has the state of the last pseudo-step.
        """
        started = time.process_time()
        self._iterations = 0
        self._steps = 0
        self._cuts = 0
        self.step += 1
        self.result = None
        self.system.q0.copy(self._start)
        if self.system.active_sets:
            self._announce_load(at)
        self._warn_of_inward_normals(at)
        self._progress = SearchProgress(self.comm, self.system.numbering.size, progress)
        try:
            with Listener() as signals:
                self._continue(at, signals)
        finally:
            self._progress.close()
        external = float(self.system.external_forces().norm())
        self._largest_load = max(self._largest_load, external)
        is_unloaded = external <= VANISHING_LOAD * self._largest_load
        if not is_unloaded:
            self._warn_of_lost_loads()
        free, is_regular = self._assess(at)
        residual, load = self._unbalanced()
        is_within_tolerance = bool(residual <= self.search.tolerance)
        if is_unloaded:
            # Nothing to compare with but earlier loads, and the round-off of the inner forces.
            absolute = max(self.search.tolerance * self._largest_load, self.newton.round_off)
            is_within_tolerance = bool(residual * load <= absolute)
        self.result = EquilibriumResult(
            residual=residual,
            iterations=self._iterations,
            steps=self._steps,
            cuts=self._cuts,
            seconds=time.process_time() - started,
            totals=self.system.totals(),
            regular=is_regular,
            free=free,
            within_tolerance=is_within_tolerance,
            prestress=self._prestress.reached(),
        )
        self._all_iterations += self.result.iterations
        self._all_seconds += self.result.seconds
        self._warn_of_quality(self.result)
        return self.result

    # ---- the result ------------------------------------------------------------------------------

    @check_arguments
    def reaction(
        self, support: NamedPart, about: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> tuple[Array, Array]:
        """Force [N] and moment [N m] about a point [m] that an item which fixes or prescribes
        coordinates exerts in the equilibrium found last, (3,) each.  Supports that hold the same
        coordinate of a node, e.g. of a corner, bear equal parts of its force."""
        self.need("reaction")
        return support_force(self.system, support, about)

    @check_arguments
    def joint_force(
        self, joint: Joint, about: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> tuple[Array, Array]:
        """Force [N] and moment [N m] about a point [m] that a joint exerts on its side `b`, (3,)
        each."""
        self.need("joint_force")
        return joint_force(self.system, joint, about)

    def need(self, what: str) -> None:
        """Raise `InputError` unless an equilibrium was found; `what` names the caller."""
        check(
            self.result is not None,
            f"{what}: no equilibrium was found yet; call find() of the Equilibrium first.",
        )

    @property
    def time(self) -> float:
        """Time of the loads [s]."""
        return self.system.time

    @property
    def totals(self) -> Totals:
        """Energies and momenta of the present state."""
        return self.system.totals()

    @property
    def account(self) -> Account:
        """How the present state was found; of a search that was stopped there is no result."""
        method = {"kind": "Continuation", "tolerance": self.search.tolerance}
        result = self.result
        if result is None:
            return Account(
                kind="equilibrium",
                method=method,
                until=self.time,
                compile_seconds=self.compile_seconds,
                caption="not an equilibrium: the search was stopped",
            )
        caption = f"equilibrium, residual {result.residual:.1e}"
        if self.time or self.step > 1:
            caption = f"equilibrium at {self.axis.words(self.time, digits=4)}"
        return Account(
            kind="equilibrium",
            method=method,
            until=self.time,
            iterations=self._all_iterations,
            last_iterations=result.iterations,
            rejected=result.cuts,
            seconds=self._all_seconds,
            compile_seconds=self.compile_seconds,
            solver=self.newton.summary(),
            caption=caption,
            details={
                "result": {
                    "residual": result.residual,
                    "within tolerance": result.within_tolerance,
                    "regular": result.regular,
                    "free motions": ", ".join(result.free) or "none",
                    "iterations": result.iterations,
                    "pseudo-steps": result.steps,
                },
                "prestress": {name: asdict(one) for name, one in result.prestress.items()},
            },
        )

    @property
    def chambers(self) -> dict[str, Any]:
        """States of the gas chambers and tanks by name."""
        found: dict[str, Any] = {}
        for scalars in self.system.scalar_unknowns:
            found |= scalars.states()
        return found

    @check_arguments
    def chamber(self, name: str) -> Any:
        """State of the gas in one chamber or tank, see `gas.contract.ChamberState`."""
        chambers = self.chambers
        known = ", ".join(chambers) or "none"
        check(
            name in chambers,
            f"The scene has no chamber '{name}'; its chambers and tanks are: {known}.",
        )
        return chambers[name]

    # ---- the search ------------------------------------------------------------------------------

    def _continue(self, at: float, signals: Listener) -> None:
        """Make pseudo-steps until the residual without inertia is small."""
        search = self.search
        tolerances = Tolerances(
            search.inner_tolerance,
            scalars=INNER_TOLERANCE,
            constraint=INNER_TOLERANCE,
            max_iterations=search.max_iterations,
        )
        h = search.first_step
        ceiling = math.inf
        residual = math.inf
        round_off = 0.0
        pseudo_time = 0.0
        reason = "none"
        tension_only = _TensionOnly(self._resists_compression)
        while residual > max(search.tolerance, min(round_off, MAX_ROUND_OFF)):
            self.newton.geometric_stiffness_delay = 0
            if tension_only.is_active:
                self.newton.geometric_stiffness_delay = ALL_TANGENTS
            try:
                used = self._step(h, at, tolerances)
            except NotConverged as failure:
                self._cuts += 1
                reason = str(failure)
                if not tension_only.retry_after_failure():
                    ceiling = h * math.sqrt(search.cut_factor)
                    h = h * search.cut_factor
            else:
                tension_only.note_success()
                pseudo_time += h
                self._check_displacement()
                residual, load = self._unbalanced()
                round_off = self.newton.round_off / load
                # A pseudo-step need not be solved better than the equilibrium; half, for safety.
                tolerances = replace(tolerances, absolute=search.tolerance * load / 2)
                is_very_fast = used <= search.fast_iterations // 3
                exponent = 1
                if is_very_fast:
                    # The ceiling is far too low for such a step: let it rise within a few steps.
                    exponent = 3
                ceiling *= search.cap_growth**exponent
                if used <= search.fast_iterations:
                    h = min(h * search.growth_factor, ceiling, MAX_STEP_RATIO * search.first_step)
            self._progress.update(
                SearchState(
                    iterations=self._iterations,
                    limit=search.total_iterations,
                    steps=self._steps,
                    step=h,
                    pseudo_time=pseudo_time,
                    residual=residual,
                    tolerance=search.tolerance,
                )
            )
            self._leave_on_signal(signals, residual)
            is_exhausted = max(self._iterations, self._steps) > search.total_iterations
            if is_exhausted or h < MIN_STEP_RATIO * search.first_step:
                raise NoEquilibrium(
                    f"No equilibrium after {self._iterations} Newton iterations in {self._steps} "
                    f"pseudo-steps: the unbalanced force is {residual:.1e} of the load, "
                    f"pseudo-step {h:.1e} s, largest in {self.system.locate(self._residual)}; last "
                    f"failure: {reason}.{remedies(self.system, self.chambers, self._pressed_films)}"
                )

    def _leave_on_signal(self, signals: Listener, residual: float) -> None:
        """End the search if a signal has come, with the state of the last pseudo-step in the
        system; `residual`, over the load, is for the log.  Collective."""
        number = signals.heard(self.comm)
        if not number:
            return
        self._progress.close()
        interrupted = Interrupted(number)
        if self.comm.rank == 0:
            LOG.warning(
                "The search for an equilibrium was stopped by %s after %d Newton iterations "
                "in %d pseudo-steps, with %.1e of the load unbalanced; "
                "the system has the state of the last pseudo-step.",
                interrupted.signal.name,
                self._iterations,
                self._steps,
                residual,
            )
        raise interrupted

    def _warn_of_quality(self, result: EquilibriumResult) -> None:
        """Warn of an equilibrium that is above the tolerance, not unique or not regular."""
        if self.comm.rank > 0:
            return
        lost = lost_prestress_words(dict(result.prestress))
        if lost:
            LOG.warning("%s", lost)
        if not result.within_tolerance:
            LOG.warning(
                "The equilibrium was found to %.1e of the load, not to the tolerance %.1e: "
                "the inner forces have a round-off of %.1e N.",
                result.residual,
                self.search.tolerance,
                self.newton.round_off,
            )
        if result.free:
            LOG.warning(
                "The equilibrium is not unique: nothing resists %s; "
                "hold it by gx.Fixed if it must not move.",
                listed(result.free),
            )
        elif not result.regular:
            LOG.warning(
                "The equilibrium is not regular: "
                "its tangent is singular or Newton's iteration without inertia does not converge, "
                "as in slack film or at a limit load; "
                "shape and modes of such parts are not unique."
            )

    @cached_property
    def _pressed_films(self) -> list[PressedFilm]:
        """What films under a pressure enclose, measured at the first search: no search changes to
        which side the normals of a stress-free shape point."""
        return measure_pressed_films(self.system)

    def _warn_of_inward_normals(self, at: float) -> None:
        """Warn of films that a pressure of time `at` [s] turns inside out: such a search takes
        hundreds of iterations."""
        for pressure in collapsing_pressures(self._pressed_films, at):
            if pressure.is_inwards and self.comm.rank == 0:
                LOG.warning("%s", pressure.words)

    def _announce_load(self, at: float) -> None:
        """Tell contact the norm of the loads of time `at` [s], which it may have to carry."""
        system = self.system
        duration = self.search.first_step
        system.time = at - duration
        y = system.begin_step(duration)
        system.time = at
        system.set_inertia(0.0)
        system.set_end(system.q0)
        system.residual(y, self._residual)
        # Supports are left out: their reactions are those of the first guess.
        external = system.external_forces()
        with external as values:
            values[system.supports.held] = 0.0
        load, _ = system.imbalance(external)
        for active_set in system.active_sets:
            active_set.set_static_load(load)

    def _step(self, h: float, at: float, tolerances: Tolerances) -> int:
        """Make one pseudo-step (1) of length h [s], infinite for no inertia, under the loads of
        time `at` [s]; return the number of Newton iterations.  If it fails the state of the system
        is unchanged."""
        system = self.system
        # Gas flows and dampers resist in the pseudo-time.  Without inertia it is so long that they
        # do not count.
        duration = h if math.isfinite(h) else self.search.first_step / MIN_STEP_RATIO
        system.time = at - duration
        y = system.begin_step(duration)
        system.set_inertia(1 / h**2)
        self.newton.tolerances = tolerances
        self._steps += 1
        try:
            _, self._y, used = self.newton.solve(self._zero, y)
        except NotConverged:
            system.set_end(system.q0)
            raise
        finally:
            self._iterations += self.newton.iterations
            system.time = at
        # The next pseudo-step starts from rest, too.
        system.commit(self._zero)
        system.time = at
        return used

    def _unbalanced(self) -> tuple[float, float]:
        """Residual without inertia over the external force, and the external force [N].  A thousand
        times the round-off of the inner forces replaces a smaller force: a scene without loads is
        in equilibrium when only round-off is left."""
        system = self.system
        system.set_inertia(0.0)
        system.residual(self._y, self._residual)
        external = float(system.external_forces().norm())
        load = max(external, self.newton.round_off / MAX_ROUND_OFF, TINY)
        unbalanced, _ = system.imbalance(self._residual)
        return unbalanced / load, load

    def _warn_of_lost_loads(self) -> None:
        """Warn if the round-off of the inner forces hides the loads.  The residual is then small
        wherever the scene is, so that what is found is too stiff by any factor: a plate bends with
        the cube of its thickness, and round-off is that of its membrane forces."""
        load = float(self.system.load_forces().norm())
        round_off = self.newton.round_off
        if 0 < load < LOST_LOAD * round_off and self.comm.rank == 0:
            LOG.warning(
                "The equilibrium does not show the loads: "
                "their %.1e N are far below the round-off of the inner forces, "
                "%.1e N, so that displacements may be too small by any factor; "
                "a plate this thin needs cells of aspect near one, or is a Membrane.",
                load,
                round_off,
            )

    def _measure_scene(self) -> float:
        """Largest coordinate of the initial state [m]: the size of the scene and its distance from
        the origin."""
        largest = 0.0
        for body in self.system.bodies:
            positions = body.initial_state()[0]
            largest = max(largest, float(np.abs(positions).max(initial=0.0)))
        return max(self.comm.allreduce(largest, op=MPI.MAX), MIN_SCENE_SIZE)

    def _check_displacement(self) -> None:
        """Check that nothing flies off: what is not held moves the farther, the longer the
        pseudo-step."""
        system = self.system
        displacement = np.abs(system.q0.array_r - self._start.array_r)
        farthest = np.array(
            [displacement[system.block(body).owned].max(initial=0.0) for body in system.bodies]
        )
        system.comm.Allreduce(MPI.IN_PLACE, farthest, op=MPI.MAX)
        k = int(farthest.argmax())
        if farthest[k] > MAX_RELATIVE_DISPLACEMENT * self._scene_size:
            raise NoEquilibrium(
                "No equilibrium: "
                f"'{system.bodies[k].name}' has moved by {farthest[k]:.1e} m and moves on; "
                "hold it, or let the loads on it balance each other."
            )

    # ---- uniqueness ------------------------------------------------------------------------------

    def _assess(self, at: float) -> tuple[tuple[str, ...], bool]:
        """Rigid motions that nothing resists, in words, and whether the tangent without inertia is
        regular under the loads of time `at` [s]: Newton's iteration starts once more from the
        solution."""
        converges = self._solve_without_inertia(at)
        system = self.system
        unbalanced, load = self._unbalanced()
        K = system.tangent()
        stiffnesses = []
        for scalars in system.scalar_unknowns:
            stiffnesses += scalars.static_stiffness()
        free = free_motions(system, K, unbalanced * (load or 1.0), stiffnesses)
        if free or not converges:
            return free, False
        # With scalar unknowns K is only a block of the matrix, and may be singular in a regular
        # one.
        is_regular = bool(system.scalar_unknowns) or not factorisation.is_singular(K)
        return free, is_regular

    def _solve_without_inertia(self, at: float) -> bool:
        """Whether Newton's iteration without inertia converges to a residual a hundred times
        smaller."""
        self.newton.geometric_stiffness_delay = 0
        residual, load = self._unbalanced()
        target = FINAL_REDUCTION * min(residual, self.search.tolerance) * load
        tolerances = Tolerances(
            relative=0.0, absolute=target, scalars=FINAL_TOLERANCE, max_iterations=FINAL_ITERATIONS
        )
        try:
            self._step(math.inf, at, tolerances)
        except NotConverged:
            return False
        return True


class _TensionOnly:
    """Decides whether pseudo-steps have the geometric stiffness of tension only.

    It is tried after a failure.  The first time that it helps, it is dropped after one pseudo-step;
    each further failure doubles the number of pseudo-steps, up to `MAX_DELAY_STEPS`.  If it has
    never helped, it is not tried again for `MAX_DELAY_STEPS` pseudo-steps.  Without terms that
    resist compression it makes no difference, and is not possible.
    """

    def __init__(self, is_possible: bool) -> None:
        self._is_possible = is_possible
        self.is_active = False
        self._times_helped = 0
        self._remaining_steps = 0  # pseudo-steps until `is_active` may change

    def retry_after_failure(self) -> bool:
        """Adapt to a pseudo-step that failed; returns whether to repeat it with the same length."""
        has_helped = self._times_helped > 0
        if self.is_active:
            if not has_helped:
                self.is_active = False
                self._remaining_steps = MAX_DELAY_STEPS
            return False
        if not self._is_possible:
            return False
        if self._remaining_steps and not has_helped:
            return False
        self.is_active = True
        self._remaining_steps = min(2**self._times_helped, MAX_DELAY_STEPS)
        return True

    def note_success(self) -> None:
        """Adapt to a pseudo-step that converged."""
        self._remaining_steps = max(self._remaining_steps - 1, 0)
        if self.is_active and self._remaining_steps == 0:
            self._times_helped += 1
            self.is_active = False
