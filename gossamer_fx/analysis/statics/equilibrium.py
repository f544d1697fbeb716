"""Static equilibria of a scene, and how good they are; `continuation` has the algorithm."""

from __future__ import annotations

import math
import time
from dataclasses import asdict
from typing import Any, Literal

from gossamer_fx.analysis.statics.continuation import Continuation, Search
from gossamer_fx.analysis.statics.result import (
    EquilibriumResult,
    assess,
    warn_of_lost_loads,
    warn_of_quality,
)
from gossamer_fx.analysis.vibration.rigid_motions import listed
from gossamer_fx.core.checks.arguments import check_arguments, collective
from gossamer_fx.core.checks.errors import NotFoundYet, check
from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.item import Item
from gossamer_fx.mechanics.terms.discrete_gradient import AtRest
from gossamer_fx.records.fields.reactions import GroundForce, Joint, joint_force
from gossamer_fx.solve.scene.scene import Scene
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.system.totals import Totals
from gossamer_fx.solve.view import LOAD_PARAMETER, Account, Sought, chamber_state, chamber_states

# What stays constant in the chambers, see `gas.balance`.
GasProcess = Literal["adiabatic", "isothermal", "held pressure"]

# External force over the largest one of earlier searches, up to which it counts as zero: after
# unloading the inner forces have round-off and no load to be compared with.
VANISHING_LOAD = 1e-6

# How an equilibrium is looked for unless something else is asked for.
DEFAULT_SEARCH = Continuation()


@check_arguments
class Equilibrium(Sought):
    """Finds the static equilibrium of a scene; its state is then in `system`, for `fields` and
    `modes`.

    Openings between chambers flow and damping resists in the pseudo-time of the continuation; at
    equilibrium both have ceased.  The gas of a closed chamber changes from its initial state by the
    process `gas`: "adiabatic" as in a run, so that it cools while a film unfolds; "isothermal", its
    temperature is constant; "held pressure", a blower holds its pressure, and nothing flows.

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

    @collective
    def __init__(
        self, scene: Scene, search: Continuation = DEFAULT_SEARCH, *, gas: GasProcess = "adiabatic"
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
        for scalars in self.system.equations.scalar_unknowns:
            scalars.set_static_process(gas)
        self._search = Search(self.system, search)
        self.axis = LOAD_PARAMETER
        self.step = 0
        self._all_iterations = 0  # of all searches
        self._all_seconds = 0.0  # CPU time [s] of all searches
        # Norm of the external forces, of all equilibria found so far [N]
        self._largest_load = 0.0
        # Motions that nothing resists, of which the log has a warning.
        self._warned_motions: set[str] = set()
        self.result: EquilibriumResult | None = None
        # What has followed a path to the present state, see `path`; None after `find`.
        self.followed: object | None = None
        self.compile_seconds = time.perf_counter() - started

    @check_arguments
    @collective
    def find(self, at: float = 0.0, *, progress: bool = True) -> EquilibriumResult:
        """Find the equilibrium under the loads and prescribed positions of a time, from the present
        state.

        For increments of load call it several times, with loads that are functions of time.
        Obstacles with a motion go from the time of the present state to `at` in as many
        pseudo-steps as the gaps need; loads and supports take the times on the way with them.

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
        self.step += 1
        self.result = None
        self.followed = None
        search = self._search
        search.run(at, progress)
        external = float(self.system.equations.external_forces().norm())
        self._largest_load = max(self._largest_load, external)
        least = VANISHING_LOAD * self._largest_load
        if not self.system.equations.load_forces().norm():
            # The reactions of a scene without loads are round-off, too.
            least = max(least, search.newton.round_off)
        is_unloaded = external <= least
        if not is_unloaded:
            warn_of_lost_loads(search)
        found = assess(search, at)
        residual, scale = search.unbalanced()
        unbalanced_force = residual * scale
        if is_unloaded:
            # Nothing to compare with but earlier loads, and the round-off of the inner forces.
            allowed = max(self.search.tolerance * self._largest_load, search.newton.round_off)
        else:
            # Loads below a thousand times that round-off end the search early: their residual is
            # that over the loads all the same.
            residual = unbalanced_force / external
            allowed = self.search.tolerance * external
        is_within_tolerance = bool(unbalanced_force <= allowed)
        self.result = EquilibriumResult(
            residual=residual,
            iterations=search.iterations,
            steps=search.steps,
            cuts=search.cuts,
            seconds=time.process_time() - started,
            totals=self.system.balance.totals(),
            regular=found.regular,
            free=found.free.rigid,
            slack=found.free.slack,
            unstable=found.unstable,
            within_tolerance=is_within_tolerance,
            prestress=search.prestress.reached(),
        )
        self._all_iterations += self.result.iterations
        self._all_seconds += self.result.seconds
        warn_of_quality(self.result, search, self._warned_motions)
        return self.result

    def take_over(self, time: float) -> None:
        """Let the next search start from the present state of the system, which `path` has found
        under the loads of a time [s]; `result` does not change."""
        self.system.unknowns.time = time
        self._search.reached = time
        self.step += 1

    # ---- the result ------------------------------------------------------------------------------

    @check_arguments
    def reaction(
        self, support: Item, about: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> tuple[Array, Array]:
        """Force [N] and moment [N m] about a point [m] that the ground exerts through an item in
        the equilibrium found last, (3,) each; `gx.probes.Reaction` is the probe.

        The item is a support, which fixes or prescribes coordinates, a joint, or a spring, rope or
        the like; of one between two bodies it is what its side `b` bears.  Supports that hold the
        same coordinate of a node, e.g. of a corner, bear equal parts of its force."""
        self.need("reaction")
        return GroundForce(self.system, support)(about)

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
        if self.result is None:
            raise NotFoundYet(
                f"{what}: no equilibrium was found yet; call find() of the Equilibrium first."
            )

    @property
    def is_known_regular(self) -> bool:
        """Whether the tangent in the present state was found to be regular: a path has left the
        state of `result`."""
        return self.result is not None and self.result.regular and self.followed is None

    @property
    def free_words(self) -> str:
        """Why the tangent may be singular, as a clause."""
        if self.result is not None and self.result.free:
            return f"nothing resists {listed(self.result.free)}"
        if self.result is not None and self.result.slack:
            return f"what is held is slack, without stiffness against {listed(self.result.slack)}"
        return "its tangent is singular, as of slack film or at a limit load"

    @property
    def time(self) -> float:
        """Time of the loads [s]."""
        return self.system.unknowns.time

    @property
    def totals(self) -> Totals:
        """Energies and momenta of the present state."""
        return self.system.balance.totals()

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
                columns={"residual": math.nan},
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
            solver=self._search.newton.summary(),
            columns={"residual": result.residual},
            caption=caption,
            details={
                "summary": result.summary(),
                "result": {
                    "residual": result.residual,
                    "within tolerance": result.within_tolerance,
                    "regular": result.regular,
                    "negative eigenvalues": "unknown" if result.unstable < 0 else result.unstable,
                    "free motions": ", ".join(result.free) or "none",
                    "slack": ", ".join(result.slack) or "none",
                    "iterations": result.iterations,
                    "pseudo-steps": result.steps,
                },
                "prestress": {name: asdict(one) for name, one in result.prestress.items()},
            },
        )

    @property
    def chambers(self) -> dict[str, Any]:
        """States of the gas chambers and tanks by name."""
        return chamber_states(self.system)

    @check_arguments
    def chamber(self, name: str) -> Any:
        """State of the gas in one chamber or tank, see `gas.contract.ChamberState`."""
        return chamber_state(self.system, name)
