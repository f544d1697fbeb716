"""Running a scene: the loop over steps, retries in sub-steps, outputs."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from mpi4py import MPI

from gossamer_fx.discrete_gradient import StressRule
from gossamer_fx.errors import InputError, StepFailure, check, on_rank_zero
from gossamer_fx.newton import Newton, NotConverged
from gossamer_fx.scene import Scene
from gossamer_fx.system import System
from gossamer_fx.totals import Totals

if TYPE_CHECKING:
    from gossamer_fx.gas.network import ChamberState


class StepSolver(Protocol):
    """A time stepper at work on a system."""

    newton: Newton

    def step(self, h: float) -> int:
        """Advance by h, return the iterations; raise `NotConverged` and change nothing."""
        ...


class Stepper(Protocol):
    """A time stepper: its step, and the rule by which it takes stresses."""

    @property
    def dt(self) -> float: ...

    @property
    def rule(self) -> StressRule: ...

    def start(self, system: System) -> StepSolver: ...


class Output(Protocol):
    """Something that looks at a run: a function of the state, unknown to the solver."""

    @property
    def times(self) -> Sequence[float]:
        """Times [s] that the run must meet exactly."""
        ...

    def open(self, run: Simulation) -> None:
        """Check the request and make the files; before anything is computed."""
        ...

    def record(self, run: Simulation, last: bool) -> None:
        """Look at the state; at the start and after every step."""
        ...

    def close(self, run: Simulation) -> None:
        """Finish the files; also after a failure."""
        ...


class Simulation:
    """A scene in time.

    Args:
        scene: what there is.
        stepper: e.g. `Midpoint(dt=1e-3)`.
        outputs: e.g. `VTX`, `Ledger`, `Probes`, `Picture`, `Progress`.
        halvings: how often a step that does not converge may be halved.

    Raises:
        InputError: what is wrong with the scene or the outputs; nothing has been computed then.
    """

    def __init__(self, scene: Scene, stepper: Stepper, outputs: Sequence[Output] = (), halvings: int = 8) -> None:
        self.scene, self.stepper, self.outputs = scene, stepper, list(outputs)
        self.comm = scene.comm
        check(halvings >= 0, f"halvings is {halvings!r}; give the number of times that a step may be halved, or zero.")
        started = time.perf_counter()
        self.system = scene.compile(stepper.rule)
        self.solver = stepper.start(self.system)
        self.compile_seconds = time.perf_counter() - started
        self.halvings = halvings
        self.step = self.iterations = self.substeps = self.last_iterations = 0
        self.seconds = 0.0
        self.until = 0.0
        self.first = self.system.book()
        self._totals: Totals | None = self.first
        self._largest = 0.0
        for output in self.outputs:
            output.open(self)

    # ---- what outputs look at ----------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """[s]"""
        return self.system.time

    @property
    def totals(self) -> Totals:
        """Energies, momenta and masses now."""
        if self._totals is None:
            self._totals = self.system.book()
        return self._totals

    @property
    def energy_error(self) -> float:
        """Closing error of the ledger, over the largest energy so far."""
        now, first = self.totals, self.first
        flows = abs(now.supplied) + abs(now.dissipated)
        self._largest = max(self._largest, now.kinetic + sum(map(abs, now.stored.values())), flows)
        missing = (now.energy - first.energy) - (now.supplied - now.dissipated)
        return missing / self._largest if self._largest else 0.0

    @property
    def mass_error(self) -> float:
        """Closing error of the gas masses, over the largest mass."""
        now, first = self.totals, self.first
        missing = now.mass - first.mass - now.mass_supplied
        return missing / max(now.mass, first.mass) if now.mass else 0.0

    @property
    def chambers(self) -> dict[str, ChamberState]:
        """States of the gas chambers and tanks by name; none if the scene has no gas."""
        found: dict[str, ChamberState] = {}
        for border in self.system.borders:
            from gossamer_fx.gas.network import GasNetwork

            if isinstance(border, GasNetwork):
                found |= {s.chamber.name: s for s in border.states}
        return found

    def chamber(self, name: str) -> ChamberState:
        """Pressure p [Pa], temperature [K], volume V [m³], mass m [kg] and internal energy U [J] of a chamber.

        Raises:
            InputError: the scene has no such chamber.
        """
        chambers = self.chambers
        known = ", ".join(chambers) or "none"
        check(name in chambers, f"The scene has no chamber '{name}'; its chambers and tanks are: {known}.")
        return chambers[name]

    # ---- running -----------------------------------------------------------------------------------------------

    def run(self, until: float) -> None:
        """Advance to the time `until` [s]; steps are evened out so that it and the outputs' times are met.

        Raises:
            StepFailure: a step failed, also in sub-steps; the outputs are complete up to it.
        """
        check(math.isfinite(until), f"until is {until!r}; give the end time in seconds.")
        check(until >= self.time, f"until is {until!r} s, but the run is at t = {self.time:.9g} s; give a later time.")
        self.until = until
        milestones = sorted({t for o in self.outputs for t in o.times if self.time < t < until} | {until})
        with ExitStack() as at_the_end:
            for output in self.outputs:
                at_the_end.callback(output.close, self)
            if self.step == 0:
                self._record(last=False)
            for milestone in milestones:
                while (left := milestone - self.time) > 1e-9 * self.stepper.dt:
                    steps = math.ceil(left / self.stepper.dt - 1e-9)
                    last = milestone == until and steps == 1
                    recorded = self.step
                    try:
                        self._advance(left / steps)
                    except StepFailure:
                        if self.step > recorded:
                            self._record(last=True)
                        raise
                    if steps == 1:
                        self.system.time = milestone
                    self._record(last)

    def _record(self, last: bool) -> None:
        for output in self.outputs:
            output.record(self, last)

    def _advance(self, h: float) -> None:
        started, before = time.perf_counter(), self.time
        self.last_iterations = 0
        try:
            self._attempt(h, self.halvings)
        finally:
            # sub-steps that were made before one failed are a step, too, and are seen by the outputs
            if self.time > before:
                self.iterations += self.last_iterations
                self.step += 1
                self._totals = None
            self.seconds += time.perf_counter() - started

    def _attempt(self, h: float, halvings: int) -> None:
        """One step, or two of half the length if it does not converge, and so on."""
        try:
            self.last_iterations += self.solver.step(h)
        except NotConverged as failure:
            if halvings == 0:
                raise StepFailure(
                    f"The step {self.step + 1} at t = {self.time:.9g} s failed, also in sub-steps of {h:.3g} s: "
                    f"{failure}."
                ) from failure
            self.substeps += 1
            self._attempt(h / 2, halvings - 1)
            self._attempt(h / 2, halvings - 1)


def make_parent(comm: MPI.Intracomm, path: Path) -> None:
    """Make the folder of an output file and try to write in it.

    Raises:
        InputError: the folder cannot be made or written.
    """

    def task() -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            probe = path.parent / f".{path.name}.try"
            probe.touch()
            probe.unlink()
        except OSError as error:
            raise InputError(
                f"Cannot write '{path}' ({error.strerror}); choose a folder that exists and is writable."
            ) from error

    on_rank_zero(comm, task)


def relative_drift(now: np.ndarray, first: np.ndarray, scale: float = 0.0) -> float:
    """Largest change of a vector over its size (or a given scale)."""
    size = max(float(np.abs(first).max()), scale)
    return float(np.abs(now - first).max()) / size if size else 0.0
