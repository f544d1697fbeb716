"""How well stage 2 of IKAROS is determined: the demo `ikaros` with one factor at a time changed.

    sail       pitch between folds, and cells between them: a finer pitch is a sail with more
               layers; the finest has 30 thousand unknowns
    largest    largest step [s]
    nudge      relative change of the spin at the start, far below any accuracy
    damping    of the film: a damping time, also with none where the film is slack, or a loss factor
               that is the same for all frequencies
    contact    activation distance [m]; the layers are 2 mm apart at the start
    residual_stiffness   compressive over tensile stiffness of the film

The sail is open when the middles of its edges are 6 m out.  "End" is after 8 s.
"""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

from demos.sails.ikaros import ARM_END, main
from demos.studies.engine.deployments import NUDGES, SPIN_DAMPING, balances
from demos.studies.engine.spreads import Expected, SpreadStudy

SAILS: dict[str, dict[str, Any]] = {
    "0.64 m": {},
    "0.64 m, 2 cells": {"refine": 2},
    "0.32 m": {"pitch": 0.32},
    "0.282 m, 2 cells": {"pitch": 0.282, "refine": 2},
}
FILMS: dict[str, dict[str, Any]] = {
    **SPIN_DAMPING,
    "1e-4 s, not slack": {"tension_only": True},
}


def problem(
    comm: MPI.Comm,
    sail: str = "0.64 m",
    damping: str = "1e-4 s",
    nudge: float = 0.0,
    **given: Any,
) -> dict[str, float]:
    """The figures of one deployment."""
    found = main(comm=comm, rpm=ARM_END * (1 + nudge), **SAILS[sail], **FILMS[damping], **given)
    return {
        "opened [s]": found["opened"],
        "largest radius [m]": found["largest_radius"],
        "tips at the end [m]": found["radius"],
        "hub at the end [rpm]": found["spin_of_hub"],
        "sail at the end [rpm]": found["spin_of_sail"],
        "largest stress [MPa]": found["largest_stress"] / 1e6,
        "lost [J]": found["dissipated"],
        **balances(found),
    }


STUDY = SpreadStudy(
    "stage_2",
    "What is determined of stage 2 of IKAROS",
    problem,
    vary={
        "sail": list(SAILS),
        "largest": [1e-2, 5e-3],
        "nudge": NUDGES,
        "damping": list(FILMS),
        "contact": [1.5e-3, 7.5e-4],
        "residual_stiffness": [1e-6, 1e-5],
    },
    expected={
        "opened [s]": Expected("not determined", 1.9, 2.9),
        "largest radius [m]": Expected("determined", 9.45, 9.95),
        "tips at the end [m]": Expected("not determined", 8.6, 9.95),
        "hub at the end [rpm]": Expected("not determined", 0.95, 2.45),
        "sail at the end [rpm]": Expected("not determined", 3.25, 4.15),
        "largest stress [MPa]": Expected("not determined", 4.9, 22.0),
        "lost [J]": Expected("not determined", 42.0, 55.0),
    },
    chance=["nudge"],
    quick={"nudge": [0.0, 1e-9]},
    quick_options={"until": 1.0, "pitch": 0.8},
    limits={"energy_error": 1e-8, "penetrations": 0},
)
