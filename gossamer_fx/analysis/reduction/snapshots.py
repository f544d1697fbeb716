"""Shapes of a film in memory, for `reduce`."""

from __future__ import annotations

from collections.abc import Sequence

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.records.outputs.output import Every, Schedule, Times
from gossamer_fx.solve.view import StateView


@check_arguments
class Snapshots:
    """Output that keeps positions of a film's nodes in memory; each rank keeps those of the nodes
    that it owns.

    Args:
        body: the film.
        every: number of steps between two shapes.
        times: times [s] of the shapes, in place of `every`.

    Attributes:
        positions: list of arrays (n, 3) [m], one for each shape.

    Raises:
        InputError: when the run starts, the film is not in its scene.

    Example:
        >>> shapes = gx.reduction.Snapshots(film, every=10)
        >>> scene = gx.Scene(film, gx.Fixed(film, "left"), gx.Gravity(film))
        >>> gx.Simulation(scene, gx.Midpoint(dt=1e-3), outputs=[shapes]).run(until=2e-2)
        >>> len(shapes.positions)
        3
    """

    def __init__(self, body: Membrane, every: Every = 1, *, times: Times = ()) -> None:
        self.body = body
        self.schedule = Schedule(every, tuple(times))
        self.positions: list[Array] = []

    @property
    def times(self) -> Sequence[float]:
        """Times [s] at which the run has to end a step; empty if shapes follow steps."""
        return self.schedule.times

    def open(self, run: StateView) -> None:
        check(
            self.body in run.system.bodies,
            f"Snapshots: '{self.body.name}' is not in the scene; give one of its films.",
        )
        self.positions.clear()

    def record(self, run: StateView, last: bool) -> None:
        if self.schedule.due(run.step, run.time, last):
            # a copy: the state changes in place
            self.positions.append(run.system.state[self.body].positions().copy())

    def close(self, run: StateView) -> None:
        """Do nothing: the shapes stay in memory."""
