"""Reinforcing tapes in the deployment of IKAROS: stage 2 of the demo `ikaros` without tapes, with
those of 25 µm × 10 mm of polyimide (EA = 750 N), and with a tenth and ten times their stiffness.

Miyazaki (KAKENHI 19360384 final report, 2009, fig. 7) bonds tapes to the film as cables, and varies
their stiffness to see whether that model disturbs the deployment.  Each case is computed from three
starts whose spins differ by 1e-9 of themselves: a difference between tapes that is not larger than
that between starts means nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mpi4py import MPI

from demos.sails.ikaros import ARM_END, main
from demos.studies.engine.deployments import LEDGER, NUDGE
from demos.studies.engine.study import Study
from gossamer_fx.extend import Result

# What the picture shows: names, axis labels and factors to their units.
PANELS: Sequence[tuple[str, str, float]] = (
    ("opened", "edges 6 m out [s]", 1.0),
    ("largest_stress", "largest stress of the film [MPa]", 1e-6),
    ("imbalance", "imbalance of the tips at the end", 1.0),
    ("dissipated", "dissipated [J]", 1.0),
)


def problem(comm: MPI.Comm, tape: float, nudge: int, until: float = 5.0) -> dict[str, float]:
    """One deployment with tapes of a stiffness EA [N], until a time [s]."""
    return main(tape=tape, rpm=ARM_END * (1 + NUDGE * nudge), until=until, largest=2e-2, comm=comm)


def draw(results: list[Result], path: Path) -> None:
    """Each figure over the stiffness of the tapes, a mark for each start."""
    from demos.common.figures import BLUE, finish, new_figure, save

    figure = new_figure(12.0, 3.4)
    done = [result for result in results if not result.failed]
    stiffnesses = sorted({float(result.values["tape"]) for result in done})
    # Evenly spaced, as none has no place on a logarithmic axis.
    x = [stiffnesses.index(float(result.values["tape"])) for result in done]
    for axes, (name, label, factor) in zip(figure.subplots(1, 4), PANELS, strict=True):
        # A sail that has not opened has an infinite time, which is left out.
        values = factor * np.array([result.numbers[name] for result in done])
        axes.plot(x, values, "_", color=BLUE, ms=14)
        axes.set_xticks(range(len(stiffnesses)), [f"{EA:g}" for EA in stiffnesses])
        axes.set_xlim(-0.5, len(stiffnesses) - 0.5)
        axes.set_ylim(0.0, 1.15 * max(values[np.isfinite(values)], default=1.0))
        finish(axes, "EA of the tapes [N]", label)
    save(figure, path, "IKAROS, stage 2, with reinforcing tapes: three starts each")


STUDY = Study(
    "tapes",
    "Reinforcing tapes in the deployment of IKAROS",
    problem,
    {"tape": [0.0, 75.0, 750.0, 7500.0], "nudge": [0, 1, 2]},
    lambda case: 1.0,
    quick={"tape": [0.0, 750.0], "nudge": [0]},
    quick_options={"until": 0.3},
    shows=("opened", "largest_stress", "tape_tension"),
    quick_shows=("largest_stress", "tape_tension"),
    not_repeatable={
        "nutation": "nothing is tilted: round-off",
        "nutation_at_start": "nothing is tilted: round-off",
        "imbalance": "nothing is uneven: in the quick form it is round-off",
    },
    limits={"energy_error": 1e-8, "penetrations": 0},
    expected_warnings={
        "taut at one end of a step only": "the inner tapes are unloaded while the sail is folded, "
        "and turn slack and taut with the stretching of the film, which no step of a deployment "
        "resolves; with steps of 5 ms edges are 6 m out after 2.502 s (EA = 750 N)"
    },
    columns=f"opened, largest_stress, tape_tension, imbalance, largest_radius, {LEDGER}",
    draw=draw,
)
