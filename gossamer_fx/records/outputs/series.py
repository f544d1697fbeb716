"""Values of probes in memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array
from gossamer_fx.records.outputs.output import Probe, evaluate_probe
from gossamer_fx.solve.view import StateView


@check_arguments
class Series:
    """Values of probes at the start and after every step, as arrays for scripts.

    `series[name]` is the array (n,) of the values of a probe, and `series.time` that of the times
    [s]; the same on every rank.  `outputs.Probes` writes the same values to a file.

    Args:
        probes: functions of the run that return a number, the same on every rank, by name.

    Raises:
        InputError: a probe is not a function; in the run, it fails, or does not return the same
            finite number on every rank; `series[name]` of an unknown name.

    Example:
        >>> ball = gx.PointMass(2.0, comm=comm, name="ball")
        >>> series = gx.Series({"height": gx.probes.Position(ball.port(), "z")})
        >>> scene = gx.Scene(ball, gx.Gravity(ball, (0.0, 0.0, -9.81)))
        >>> gx.Simulation(scene, gx.Midpoint(dt=0.1), outputs=[series]).run(until=0.2)
        >>> [round(z, 4) for z in series["height"].tolist()]
        [0.0, -0.0491, -0.1962]
    """

    times: Sequence[float] = ()

    def __init__(self, probes: Mapping[str, Probe]) -> None:
        self.probes = dict(probes)
        for name, probe in self.probes.items():
            check(
                callable(probe),
                f"Probe '{name}' is {probe!r}; give a function of the run that returns a number.",
            )
        self._rows: list[list[float]] = []

    def open(self, run: StateView) -> None:
        """Nothing to prepare; rows of an earlier run with the same series are kept."""

    def record(self, run: StateView, last: bool) -> None:
        row = [run.time]
        for name, probe in self.probes.items():
            row.append(evaluate_probe(run, f"Probe '{name}'", probe))
        self._rows.append(row)

    def close(self, run: StateView) -> None:
        """Nothing to close."""

    @property
    def time(self) -> Array:
        """Times [s] of the start and of every step so far, (n,)."""
        return self._column(0)

    def __getitem__(self, name: str) -> Array:
        """Values (n,) of a probe at the times of `time`; an unknown name is refused."""
        check(
            name in self.probes,
            f"The series has no '{name}'; its names are: {', '.join(self.probes) or 'none'}.",
        )
        return self._column(1 + list(self.probes).index(name))

    def _column(self, k: int) -> Array:
        """The values of a column, (n,); the first one is the time."""
        return np.array([row[k] for row in self._rows])
