"""Numbers of a run in memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import Array
from gossamer_fx.outputs.output import Probe, evaluate_probe
from gossamer_fx.probes.run import Run


@check_arguments
class Series:
    """Values of probes at the start and after every step, for scripts that compute or draw with them.

    `series["tip"]` is the array of a probe's values, `series.time` that of the times [s]; the same on every rank.  What
    is to be read from a file is written by `Probes`.

    Args:
        probes: functions of the run that return a number, the same on every rank, by name.

    Raises:
        InputError: a probe that raises, or returns something else than a finite number, or different ones on
            different ranks; a name that is not among them.
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

    def open(self, run: Run) -> None:
        pass

    def record(self, run: Run, last: bool) -> None:
        self._rows.append(
            [
                run.time,
                *(
                    evaluate_probe(run, f"Probe '{name}'", probe)
                    for name, probe in self.probes.items()
                ),
            ]
        )

    def close(self, run: Run) -> None:
        pass

    @property
    def time(self) -> Array:
        """[s], at the start and after every step so far."""
        return self._column(0)

    def __getitem__(self, name: str) -> Array:
        check(
            name in self.probes,
            f"The series has no '{name}'; its names are: {', '.join(self.probes) or 'none'}.",
        )
        return self._column(1 + list(self.probes).index(name))

    def _column(self, k: int) -> Array:
        return np.array([row[k] for row in self._rows])
