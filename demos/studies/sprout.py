"""Convergence of the demo `sprout` with tubes of 0.6 m: the deployment, and equilibria of the open
figure.

Compared is what a designer asks: when the tubes are open, how far apart the tips are, the
pressures.  The tips swing after the deployment, so that their distance is also given as a mean over
the last half of the time, and at rest.  Folded film moves chaotically: a row is also computed with
the tank's pressure changed by 1e-9 of itself ("nudged"); what differs between the two is what no
mesh can tell.

At rest: "as built", the film is tied to tubes with flat roots and cut for flat tubes; "a tube with
a flat root" has no film; "cut for round tubes" has round roots, so that the half angle of the V is
that of the figure, 30 degrees; "hung", the film hangs by its corners between tubes of 1.5 m.
"""

from __future__ import annotations

from mpi4py import MPI

from demos.inflatables.sprout import PRESSURE, Attachment, Roots, deployed, main
from demos.studies.engine.deployments import LEDGER, STARTS, nudged
from demos.studies.engine.study import NOT_REGULAR, Study, search_figures

# States at rest: how the film is attached, how the roots are, and the lengths of cells [m].
AT_REST: dict[str, tuple[Attachment, Roots, list[float]]] = {
    "as built": ("tied", "flat", [0.06, 0.034, 0.02, 0.012]),
    "a tube with a flat root": ("none", "flat", [0.06, 0.012, 0.008, 0.004]),
    "cut for round tubes": ("tied", "round", [0.016, 0.0107, 0.0071]),
    "hung": ("hung", "round", [0.016, 0.0107, 0.0071]),
}


def problem(comm: MPI.Comm, state: str, cell: float, until: float = 0.18) -> dict[str, float]:
    """Deploy tubes and film with cells of some length [m], or find a state at rest."""
    if state in AT_REST:
        attachment, roots, _ = AT_REST[state]
        satellite = deployed(
            comm,
            # The film that is hung is cut for tubes of 1.5 m, which bend more.
            length=1.5 if attachment == "hung" else 0.6,
            # After the deployment of the shorter tubes it is less.
            pressure=PRESSURE if attachment == "hung" else 8.1e3,
            cell=cell,
            film_cell=5 * cell,
            held=True,
            attachment=attachment,
            roots=roots,
        )
        found = search_figures(satellite.statics.find())
        return found | {"span": satellite.span(), "half angle [deg]": satellite.half_angle()}
    run = main(
        until=until,
        length=0.6,
        rows=1,
        tank=5e-4,
        damping=3e-4,
        cell=cell,
        # Widths of cells in proportion to the length, as those of the demo.
        fine=0.2 * cell / 0.06,
        coarse=0.3 * cell / 0.06,
        largest=2e-4,
        pressure=nudged(20e3, state),
        comm=comm,
    )
    pressures = [value for name, value in run.items() if name.startswith("pressure")]
    return run | {"least pressure": min(pressures), "largest pressure": max(pressures)}


STUDY = Study(
    "sprout",
    "Convergence of two tubes and a film: deploying, and at rest",
    problem,
    {"state": STARTS, "cell": [0.06, 0.034, 0.0235]},
    lambda case: case["cell"],
    finer=[{"state": state, "cell": h} for state, (*_, cells) in AT_REST.items() for h in cells],
    quick={"state": ["usual", "as built"], "cell": [0.06]},
    quick_options={"until": 3e-3},
    shows=("span", "half angle [deg]"),
    limits={"energy_error": 1e-8, "penetrations": 0},
    columns=(
        "opened, half angle [deg], span, span_mean, reach, spin, least pressure, largest pressure, "
        f"{LEDGER}"
    ),
    may_fail=True,
    expected_warnings=NOT_REGULAR,
)
