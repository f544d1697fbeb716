"""This program as a contestant: own_program.py PROBLEM [key=value ...] solves one problem.

The function of a problem has its name.  Its keyword arguments are the words of `problems.toml`, and
it returns figures by name.  The last line that is printed is a JSON object with the figures, and
with the warnings of the program.
"""

from __future__ import annotations

import inspect
import json
import math
import sys
import time
from collections.abc import Callable
from types import SimpleNamespace

import contact_scene
import numpy as np
from contact_cost import contact_cost
from contestants import Clock, words
from gradient_cost import gradient
from mpi4py import MPI
from newton_times import profile
from rank_counts import rank_counts
from scaling_model import scaling_model
from shared_problems import (
    BLOWN_UNTIL,
    CASES,
    MASS_DAMPING,
    MODULI,
    RISE,
    instants_of,
    volume_below,
)
from stopwatch import Stopwatch

import gossamer_fx as gx
from demos.antennas import antenna_pendulum
from demos.common import flat_rooted_tube
from demos.films import spinning_sheet
from demos.inflatables import inflate_tube
from demos.studies import airbag as airbag_study
from demos.studies import orthotropic as orthotropic_study
from gossamer_fx.extend import FilmLaw, recorded_warnings, relative_drift
from gossamer_fx.mechanics.contact.geometry.facets import facets_of
from gossamer_fx.meshes.arrays import mesh_of_arrays
from gossamer_fx.meshes.plates import slit_ring
from gossamer_fx.meshes.sheet import sheet as sheet_mesh
from gossamer_fx.solve.solvers import newton

Figures = dict[str, float]
COMM = MPI.COMM_WORLD

# A plastic film of 0.1 mm, in SI units.
PLASTIC = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}

# Steps of the orthotropic sheets before the first that is measured: they begin to wrinkle.
FIRST_STEPS = 2
# Stiffnesses per width of braids for inflatable decelerators [N/m]; their condition is 124 and 323.
STEEP_BRAID = gx.Orthotropic.from_stiffnesses(
    75.6e3, 502.0e3, 4014.0e3, 504.1e3, **orthotropic_study.AXES, **orthotropic_study.MASS
)
FILMS: dict[str, FilmLaw] = {
    "isotropic": orthotropic_study.LAWS["TensionField"],
    "fabric": orthotropic_study.LAWS["10:1"],
    "braid": orthotropic_study.LAWS["braid"],
    "steep braid": STEEP_BRAID,
}


# ---- first steps of demos ------------------------------------------------------------------------


def sheet(
    n: int = 40,
    steps: int = 5,
    dt: float = 1e-3,
    wrinkling: int = 1,
    relative: float = 1e-10,
    tied: int = 0,
) -> Figures:
    """The free sheet of the demo `spinning_sheet`; `tied`: cut in two, whose edges are tied."""
    watch = Stopwatch()
    law: FilmLaw = gx.Linear(**PLASTIC)
    if wrinkling:
        law = gx.Miyazaki(**PLASTIC, residual_stiffness=1e-6)
    scene = gx.Scene(gx.Membrane(sheet_mesh(COMM, n, n), law, velocity=spinning_sheet.throw))
    if tied:
        halves = []
        for shift in np.array([[[0.0], [0.0], [0.0]], [[0.5], [0.0], [0.0]]]):
            half = gx.Membrane(
                sheet_mesh(COMM, n // 2, n, 0.5, 1.0),
                law,
                name=f"half {len(halves) + 1}",
                displacement=lambda X, shift=shift: 0 * X + shift,
                velocity=lambda X, shift=shift: spinning_sheet.throw(X + shift),
            )
            halves.append(half)
        tie = gx.Tie(halves[1], halves[0], group_a="left", group_b="right")
        scene = gx.Scene(*halves, tie)
    stepper = gx.Midpoint(dt=dt, tolerances=gx.Tolerances(relative=relative))
    run = gx.Simulation(scene, stepper)
    figures = watch.measure(run, steps * dt)
    drift = relative_drift(run.totals.angular_momentum, run.first.angular_momentum)
    return figures | {"unconverged": 0, "ΔL/L": drift}


def tube(cells: int = 14, steps: int = 20, dt: float = 1e-4) -> Figures:
    """The tube of the demo `inflate_tube`."""
    watch = Stopwatch()
    run = inflate_tube.build(COMM, cells=cells, dt=dt).simulation()
    figures = watch.measure(run, steps * dt)
    return figures | {"p [Pa]": run.chamber("tube").pressure, "Δm/m": abs(run.mass_error)}


def folded_tube(cells: int = 4, until: float = 3e-3) -> Figures:
    """A folded tube whose film nothing damps."""
    watch = Stopwatch()
    case = flat_rooted_tube.build(COMM, cells=cells, damping=0.0, iterations=0)
    run = case.simulation()
    figures = watch.measure(run, until)
    contacts = [item for item in case.scene.items if isinstance(item, gx.Contact)]
    penetrations = sum(gx.probes.Penetrations(contact)(run) for contact in contacts)
    return figures | {"Δm/m": abs(run.mass_error), "penetrations": penetrations}


def antenna(cells: int = 20, steps: int = 3, dt: float = 5e-3) -> Figures:
    """The antenna of the demo `antenna_pendulum`, whose film multipliers tie to the booms."""
    watch = Stopwatch()
    run = antenna_pendulum.build(COMM, cells, 2 * cells, dt=dt).simulation()
    return watch.measure(run, steps * dt)


def pendulum(
    n: int = 6,
    elements: int = 12,
    order: int = 2,
    dt: float = 1e-2,
    until: float = 2.0,
    shell: int = 0,
) -> Figures:
    """The whole swing of that antenna."""
    watch = Stopwatch()
    swing = antenna_pendulum.build(COMM, n, elements, until, dt, order, bool(shell))
    series = gx.Series(swing.probes)
    figures = watch.measure(swing.simulation([series]), until)
    film = series["film [m]"]
    instants = np.array(instants_of(until))
    # At the end and over the time: the film vibrates, so that its value at the end depends on the
    # phase.
    return figures | {
        "tip [mm]": 1e3 * series["tip [m]"][-1],
        "tips [mm]": (1e3 * np.interp(instants, series.time, series["tip [m]"])).tolist(),
        "film, end [mm]": 1e3 * film[-1],
        "film, rms [mm]": 1e3 * np.sqrt(np.mean(film**2)),
        "film, largest [mm]": 1e3 * film.max(),
    }


# ---- equilibria ----------------------------------------------------------------------------------


def found_by(search: gx.Equilibrium) -> tuple[Figures, gx.analysis.EquilibriumResult]:
    """Find an equilibrium, and return the times, the unknowns and the iterations as "steps", and
    the result."""
    clock = Clock()
    found = search.find()
    figures = {
        **clock.figures(),
        "dofs": search.system.unknowns.numbering.size,
        "steps": found.iterations,
    }
    return figures, found


def airbag(n: int = 8, order: int = 1, law: str = "isotropic", angle: float = 0.0) -> Figures:
    """Quarter of one sheet of the square airbag at rest; see `demos/studies/airbag.py`."""
    film_law = airbag_study.LAWS["Miyazaki 1e-6"]
    if law == "fabric":
        turn = math.radians(angle)
        # The direction of the fabric's first moduli, in the plane of the film.
        film_law = gx.Orthotropic(
            **MODULI,
            density=airbag_study.FILM["density"],
            thickness=airbag_study.FILM["thickness"],
            direction=(math.cos(turn), math.sin(turn), 0.0),
            residual_stiffness=1e-6,
        )
    film, search = airbag_study.airbag(COMM, film_law, order, n)
    figures, found = found_by(search)
    height = airbag_study.displacement(film, search, "bottom left")[2]
    volume, potential = airbag_study.volume_and_potential(found)
    return figures | {"w_M": float(height), "V": volume, "potential": potential}


def blown(n: int = 8, dt: float = 1e-3) -> Figures:
    """That quarter while its pressure rises: the volume of the airbag at instants."""
    watch = Stopwatch()
    film, search = airbag_study.airbag(COMM, airbag_study.LAWS["Miyazaki 1e-6"], 1, n)
    held = [item for item in search.scene.items if isinstance(item, gx.Fixed)]
    pressure = gx.Pressure(film, lambda t: airbag_study.PRESSURE * min(t / RISE, 1.0))
    damping = gx.Damping(film, mass_factor=MASS_DAMPING)
    facets = facets_of(film)
    corners = film.space.tabulate_dof_coordinates()[facets.nodes][facets.triangles]
    # All triangles in one sense: those of the mesh are in any.
    is_turned = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] < 0
    triangles = np.where(is_turned[:, None], facets.triangles[:, ::-1], facets.triangles)

    def volume(run: gx.Simulation) -> float:
        owned = run.system.unknowns.state[film].owned
        return volume_below(
            run.system.unknowns.q0.array_r[owned].reshape(-1, 3)[facets.nodes], triangles
        )

    series = gx.Series({"volume [m3]": volume})
    scene = gx.Scene(film, pressure, damping, *held)
    run = gx.Simulation(scene, gx.Midpoint(dt=dt), outputs=[series])
    figures = watch.measure(run, BLOWN_UNTIL)
    instants = instants_of(BLOWN_UNTIL)
    return figures | {"volumes": np.interp(instants, series.time, series["volume [m3]"]).tolist()}


def plate(shape: str = "strip", n: int = 16, step: float = 50.0) -> Figures:
    """The cantilever and the slit ring of Sze, Liu & Lo under their whole load at once; see
    `demos/studies/plate.py`."""
    case = CASES[shape]
    # Without a Poisson effect the strip has the closed form of a beam.
    law = gx.Linear(E=case.E, nu=0.0, density=1.0, thickness=case.thickness)
    if shape == "strip":
        body = gx.Plate(sheet_mesh(COMM, n, max(n // 8, 1), 10.0, 1.0), law)
        held = "left"
        loaded = "right"
    else:
        body = gx.Plate(slit_ring(COMM, n // 2, 4 * n, 6.0, 10.0), law)
        held = "end"
        loaded = "start"
    load = gx.loads.EdgeLoad(body, loaded, force=(0.0, 0.0, case.load))
    search = gx.Equilibrium(
        gx.Scene(body, gx.Fixed(body, held, rotation=True), load),
        gx.analysis.Continuation(first_step=step),
    )
    figures, _ = found_by(search)
    # Vertical coordinates; the reference is the largest deflection of the loaded edge.
    z = search.system.unknowns.q0.array_r[2::3]
    deflection = float(z[body.nodes(loaded)].max())
    return figures | {"W": deflection, "error [%]": 100 * abs(deflection / case.deflection - 1)}


# ---- contact, and laws side by side --------------------------------------------------------------


def contact(n: int = 10, dt: float = 1e-4, until: float = 0.01, law: str = "barrier") -> Figures:
    """The two films of `contact_scene.py`, with contact that conserves."""
    watch = Stopwatch()
    X, triangles = contact_scene.grid(n)

    def square() -> gx.Mesh:
        return mesh_of_arrays(COMM, lambda: (X, triangles, {}))

    film_law = gx.Linear(
        E=contact_scene.E,
        nu=contact_scene.NU,
        density=contact_scene.DENSITY,
        thickness=contact_scene.THICKNESS,
    )
    lower = gx.Membrane(square(), film_law, name="lower")
    upper = gx.Membrane(
        square(),
        film_law,
        displacement=lambda X: (contact_scene.thrown(X.T)[0] - X.T).T,
        velocity=lambda X: contact_scene.thrown(X.T)[1].T,
        name="upper",
    )
    pair = gx.Contact(lower, upper, distance=contact_scene.DISTANCE, law=law)
    run = gx.Simulation(gx.Scene(pair), gx.Midpoint(dt=dt))
    figures = watch.measure(run, until)
    # Both films as one set of triangles, whose edges are tested against each other.
    films = [facets_of(film) for film in (lower, upper)]
    positions = []
    velocities = []
    for film, facets in zip((lower, upper), films, strict=True):
        owned = run.system.unknowns.state[film].owned
        positions.append(run.system.unknowns.q0.array_r[owned].reshape(-1, 3)[facets.nodes])
        velocities.append(run.system.unknowns.v0.array_r[owned].reshape(-1, 3)[facets.nodes])
    all_triangles = np.vstack([films[0].triangles, films[1].triangles + len(positions[0])])
    kept = ("cpu", "wall", "dofs", "steps", "Newton/step", "rejected", "ΔE/E")
    return {name: figures[name] for name in kept} | {
        "ΔP/P": relative_drift(run.totals.momentum, run.first.momentum),
        "ΔL/L": relative_drift(run.totals.angular_momentum, run.first.angular_momentum),
        "penetrations": contact_scene.penetrations(np.vstack(positions), all_triangles),
        **contact_scene.figures_of_upper(
            np.vstack(positions), np.vstack(velocities), all_triangles
        ),
    }


def orthotropic(law: str = "braid", order: int = 1, n: int = 48, steps: int = 20) -> Figures:
    """The law of orthotropic film against that of isotropic film, on the thrown free sheet of the
    study `orthotropic`.

    The two sheets take turns, a step each, so that what else runs on the machine slows both down.
    """
    # The solver's clocks tell wall time; here the machine may be shared.
    newton.time = SimpleNamespace(perf_counter=time.process_time)
    dt = orthotropic_study.DT
    runs = {}
    for name in ("isotropic", law):
        film = gx.Membrane(
            sheet_mesh(COMM, n, n), FILMS[name], order=order, velocity=orthotropic_study.thrown
        )
        runs[name] = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=dt))
        runs[name].run(until=FIRST_STEPS * dt)
    # Seconds of the law in an iteration, and iterations, of each step.
    law_seconds: dict[str, list[float]] = {name: [] for name in runs}
    counts: dict[str, list[int]] = {name: [] for name in runs}
    clock = Clock()
    for step in range(FIRST_STEPS + 1, FIRST_STEPS + steps + 1):
        for name, run in runs.items():
            solver = run.solver.newton
            seconds = solver.seconds["law"]
            iterations = solver.all_iterations
            run.run(until=step * dt)
            counts[name].append(solver.all_iterations - iterations)
            law_seconds[name].append((solver.seconds["law"] - seconds) / counts[name][-1])
    own_time = float(np.median(law_seconds[law]))
    isotropic_time = float(np.median(law_seconds["isotropic"]))
    return {
        "ratio": own_time / isotropic_time,
        **clock.figures(),
        "dofs": runs[law].system.unknowns.numbering.size,
        "steps": steps,
        "law [ms]": 1e3 * own_time,
        "isotropic law [ms]": 1e3 * isotropic_time,
        "Newton/step": float(np.mean(counts[law])),
        "isotropic Newton/step": float(np.mean(counts["isotropic"])),
    }


SOLVERS: tuple[Callable[..., Figures], ...] = (
    *(sheet, tube, folded_tube, antenna, pendulum, airbag, blown, plate, contact, orthotropic),
    *(profile, rank_counts, scaling_model, gradient, contact_cost),
)


def main() -> None:
    """Solve the problem that the command line names, and print its figures."""
    problem = sys.argv.pop(1)
    solve = {solver.__name__: solver for solver in SOLVERS}[problem]
    defaults = {name: one.default for name, one in inspect.signature(solve).parameters.items()}
    with recorded_warnings() as own_warnings:
        figures = solve(**words(defaults))
    warnings = [text for texts in COMM.allgather(own_warnings) for text in texts]
    if COMM.rank == 0:
        numbers = {name: np.asarray(value).real.tolist() for name, value in figures.items()}
        print(json.dumps(numbers | {"warnings": list(dict.fromkeys(warnings))}))


if __name__ == "__main__":
    main()
