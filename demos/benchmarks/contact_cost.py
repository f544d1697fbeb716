"""What contact adds to a Newton iteration: a stack of square films that lie on each other, against
the same without it.

Five films of equal meshes, each turned by some degrees so that their nodes do not lie on each
other, are moved towards the next ones until all layers touch.  `part` is the part of each film that
does: the rest is bent away.  The sizes of cells, distance and step are the same for all numbers of
`vertices`, so that the films grow.
"""

from __future__ import annotations

import time

import numpy as np
from mpi4py import MPI
from stopwatch import Timed

import gossamer_fx as gx
from gossamer_fx.mechanics.contact.broad_phase.candidates import nearest_gaps
from gossamer_fx.mechanics.contact.contact_set import ContactSet
from gossamer_fx.mechanics.contact.pairs import PairDistances
from gossamer_fx.meshes.sheet import sheet

# m, m, s
CELL = 5e-3
DISTANCE = 1e-3
STEP = 1e-4
LAYERS = 5
SPEED = 1.0  # m/s at which layers come to the middle one
GAP = 1.2  # over the layers between; over the distance
LAW = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
WARM = 5  # steps until they touch


def stack(comm: MPI.Comm, vertices: int, part: float) -> list[gx.Membrane]:
    """Films, of which the part x < part · size lies GAP distances from the next one."""
    n = max(round((vertices / LAYERS) ** 0.5) - 1, 2)
    size = n * CELL
    films = []
    for k in range(LAYERS):
        turn = 0.3 * k
        level = k - (LAYERS - 1) / 2
        c = np.cos(turn)
        s = np.sin(turn)

        def placed(X: np.ndarray, c: float = c, s: float = s, level: float = level) -> np.ndarray:
            x = X[0] - size / 2
            y = X[1] - size / 2
            x, y = c * x - s * y, s * x + c * y
            away = np.maximum(x / size + 0.5 - part, 0.0) if part < 1 else 0 * x
            slope = 0.05 * np.sqrt(away**2 + 1e-6)  # of a film; gentle, so that its strain is small
            return np.vstack([x, y, level * (GAP * DISTANCE + (part < 1) * slope * size)])

        films.append(
            gx.Membrane(
                sheet(comm, n, n, size, size),
                gx.Miyazaki(**LAW, residual_stiffness=1e-6),
                name=f"film {k}",
                displacement=lambda X, placed=placed: placed(X) - X,
                velocity=lambda X, level=level: thrown(X, -level * SPEED),
            )
        )
    return films


def thrown(X: np.ndarray, speed: float) -> np.ndarray:
    """A film at a speed, which flutters, so that a step without contact takes some iterations,
    too."""
    flutter = 0.3 * np.sin(
        np.outer((150.0, 220.0, 310.0), X[0]) + np.outer((280.0, 130.0, 190.0), X[1])
    )
    flutter[2] += speed
    return flutter


def contact_set_of(run: gx.Simulation) -> ContactSet:
    (contact_set,) = (c for c in run.system.equations.compiled if isinstance(c, ContactSet))
    return contact_set


def contact_cost(vertices: int = 1000, part: float = 1.0, steps: int = 4) -> dict[str, float]:
    """Figures of some steps of packed films, in turn with contact and without; times are of CPU, of
    all ranks.

    `ratio` is a Newton iteration, with its part of the search and checks of its step, over one
    without contact; `touching` is the part of vertices in contact, and `search` that of contact's
    time.
    """
    comm = MPI.COMM_WORLD
    runs = []
    cpu = [0.0, 0.0]
    iterations = [0, 0]
    for with_contact in (True, False):
        films = stack(comm, vertices, part)
        items = [gx.Contact(*films, distance=DISTANCE)] if with_contact else films
        runs.append(gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=STEP)))
    contact_set = contact_set_of(runs[0])
    search = Timed(contact_set, "update_active_set", "extend_active_set", "inadmissible")
    forces = Timed(contact_set, "add_forces")
    tangents = Timed(contact_set, "add_tangents", "coupling_matrices")
    for run in runs:
        run.run(until=WARM * STEP)
    clocks = (search, forces, tangents)
    before = [clock.total for clock in clocks]
    touching = []
    for k in range(WARM, WARM + steps):
        for i, run in enumerate(runs):
            first = run.solver.newton.all_iterations
            started = time.process_time()
            run.run(until=(k + 1) * STEP)
            cpu[i] += comm.allreduce(time.process_time() - started)
            iterations[i] += run.solver.newton.all_iterations - first
        candidates = contact_set.candidates
        gap = PairDistances.of(candidates, contact_set.accepted.x).gap
        nearest = nearest_gaps(candidates, gap, contact_set.mesh)
        touching.append((nearest < DISTANCE).mean())
    spent = [comm.allreduce(clock.total - b) for clock, b in zip(clocks, before, strict=True)]
    with_contact, alone = (1e3 * cpu[i] / iterations[i] for i in (0, 1))
    newton = runs[0].solver.newton
    return {
        "vertices": contact_set.points.body_count,
        "touching": float(np.mean(touching)),
        "iteration [ms]": with_contact,
        "alone [ms]": alone,
        "ratio": with_contact / alone,
        "search [ms]": 1e3 * spent[0] / iterations[0],
        "forces [ms]": 1e3 * spent[1] / iterations[0],
        "tangents [ms]": 1e3 * spent[2] / iterations[0],
        **{f"{part} [ms]": 1e3 * s / newton.all_iterations for part, s in newton.seconds.items()},
        "Newton/step": iterations[0] / steps,
        "alone Newton/step": iterations[1] / steps,
        "Krylov/Newton": newton.linear_iterations / newton.all_iterations,
        "searches": contact_set.search.count,
        "ΔE/E": abs(runs[0].energy_error),
    }
