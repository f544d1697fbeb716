"""The membrane antenna swings from one corner under g = 1 m/s² for two seconds.

The antenna of the demo `antenna_attitude`, horizontal and at rest, corner C on a ball joint.  In
the rigid limit, for any masses of film and booms,

    θ'' = (12 g/(7 d)) cos θ,    d = √2 · 2.1 m,    tip A at depth d sin θ

(all masses on squares and diagonals of the same d give the same ratio of moment to inertia).  Only
the deviation from it depends on the discretisation: the two booms cross without a joint between
them, so that the antenna slowly becomes a saddle, with the film alone as resistance; and the film
sags between the booms.  The figures of the paper agree with a commercial code within 0.02 m; the
demo `antenna_reference` compares with the model of that code.

`./gossamer demo antenna_pendulum` runs the resolutions of the paper and finer ones, with linear and
quadratic films, and draws errors against unknowns and run time.  One of them, to look at:

    ./gossamer run demos/antennas/antenna_pendulum.py cells=4 elements=8 --output out/swing
    ./gossamer report out/swing
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.integrate import solve_ivp

import gossamer_fx as gx
from demos.antennas.antenna_attitude import FILM, SIDE, antenna
from demos.common.deployment import effort, run_case
from demos.common.figures import finish, new_figure, save
from gossamer_fx.extend import Stepper

G = 1.0  # m/s²
# Order of the film, cells of a side, elements of a boom; the last one is the reference.
RESOLUTIONS = (
    *((1, n, 2 * n) for n in (2, 3, 4, 6, 9)),
    *((2, n, 2 * n) for n in (2, 3, 4, 6, 9, 12)),
)


def rigid_angle(t: np.ndarray) -> np.ndarray:
    """θ(t) [rad] of the rigid limit from rest at θ = 0, at times t (n,) [s] from 0 on."""
    rate = 12 * G / (7 * SIDE * 2**0.5)
    found = solve_ivp(
        lambda _, y: (y[1], rate * np.cos(y[0])),
        (0.0, t[-1]),
        (0.0, 0.0),
        t_eval=t,
        rtol=1e-10,
        atol=1e-12,
    )
    return np.asarray(found.y[0])


class FilmDeflection:
    """A probe: deflection of a film [m] from the bilinear surface that its corners A, B, C, D span.

    It is the root mean square, over the mass of the film, of the distance along the normal to the
    plane of B, C and D.
    """

    def __init__(self, film: gx.Membrane, corners: Sequence[gx.Port]) -> None:
        self._film = film
        self._corners = corners
        owned_points = film.space.tabulate_dof_coordinates()[: film.block.index_map.size_local]
        x, y, _ = owned_points.T / (SIDE / 2)
        # Bilinear shape functions of the corners, one a column.
        signs = (
            (1, 1),
            (-1, 1),
            (-1, -1),
            (1, -1),
        )
        self._bilinear = np.array([(1 + a * x) * (1 + b * y) / 4 for a, b in signs]).T

    def __call__(self, run: gx.Simulation) -> float:
        system = run.system
        owned = system.unknowns.state[self._film].owned
        distance = system.unknowns.numbering.vector()
        corners = system.unknowns.state.vectors(self._corners)
        _, B, C, D = corners
        normal = np.cross(D - C, B - C)
        normal /= np.linalg.norm(normal)
        positions = system.unknowns.q0.array_r[owned].reshape(-1, 3)
        with distance as values:
            # Distance of each node from the bilinear surface, along the normal.
            heights = (positions - self._bilinear @ corners) @ normal
            # As a vector at each node, so that the mass matrix can weigh it.
            values[owned] = np.outer(heights, normal).ravel()
        mass = FILM.density * FILM.thickness * SIDE**2
        return float(distance.dot(system.unknowns.M * distance) / mass) ** 0.5


def build(
    comm: MPI.Comm,
    cells: int = 3,
    elements: int = 6,
    until: float = 2.0,
    dt: float = 5e-3,
    order: int = 1,
    shell: bool = False,
    stiffer: float = 1.0,
) -> gx.Case:
    """The antenna with cells × cells squares of film and `elements` a boom, hinged at C; probes of
    both.

    Its film may be a `shell` that does not wrinkle, as in the commercial code of the paper, and its
    booms `stiffer` by a factor.
    """
    model = antenna(comm, cells, elements, order, shell, stiffer)
    corners = [model.film.port_at(point) for point in model.points[:4]]
    hinge = gx.constraints.BallJoint(
        corners[2], gx.Ground(tuple(model.points[2].tolist())), name="hinge"
    )
    weights = [gx.Gravity(body, (0, 0, -G)) for body in (model.film, *model.booms)]
    probes = {
        "tip [m]": gx.probes.Position(corners[0], "z"),
        "film [m]": FilmDeflection(model.film, corners),
    }
    scene = gx.Scene(*model.items, hinge, *weights)
    return gx.Case(
        scene,
        gx.Midpoint(dt=dt),
        until=until,
        title="The membrane antenna, hung at a corner",
        probes=probes,
    )


def main(
    stepper: Stepper | None = None,
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **given: float,
) -> dict:
    """Run the pendulum; `given` are arguments of `build`.  Returns heights and deflections [m] over
    the time.

    With `output`, a folder: the recording of the run.
    """
    case = build(comm, **given)
    run, series = run_case(case, output, stepper=stepper)
    time = series.time
    tip = series["tip [m]"]
    film = series["film [m]"]
    # The corner opposite the hinge is a diagonal of the square away from it.
    rigid = -SIDE * 2**0.5 * np.sin(rigid_angle(time))
    return {
        "time": time,
        "tip": tip,
        "film": film,
        "rigid_tip": rigid,
        "deviation": float(np.abs(tip - rigid).max()),
        "film_deflection": float(film.max()),
        **effort(run),
    }


def errors(
    results: dict[tuple[int, int, int], dict],
) -> dict[tuple[int, int, int], tuple[float, float]]:
    """Largest differences of tip and film deflection [m] to the last resolution, over the time."""
    *coarser, finest = results
    reference = results[finest]
    return {
        key: tuple(
            float(np.abs(results[key][what] - reference[what]).max()) for what in ("tip", "film")
        )
        for key in coarser
    }


def plot(results: dict[tuple[int, int, int], dict], path: Path) -> None:
    """Tip and film over the time, and their errors over unknowns and run time."""
    figure = new_figure(11.0, 8.0)
    (tip, by_size), (film, by_seconds) = figure.subplots(2, 2)
    for (order, cells, elements), r in results.items():
        # Colours follow the order of plotting; the line tells the order of the film.
        style = {
            "label": f"{cells}×{cells}-{elements}, P{order}",
            "ls": "--" if order == 1 else "-",
        }
        tip.plot(r["time"], 1e3 * (r["tip"] - r["rigid_tip"]), **style)
        film.plot(r["time"], 1e3 * r["film"], **style)
    found = errors(results)
    for order in sorted({key[0] for key in found}):
        keys = [key for key in found if key[0] == order]
        for what, mark in ((0, "o-"), (1, "s--")):
            values = [1e3 * found[key][what] for key in keys]
            label = f"{('tip', 'film')[what]}, P{order}"
            for axes, effort_of in ((by_size, "dofs"), (by_seconds, "seconds")):
                x = [results[key][effort_of] for key in keys]
                axes.loglog(x, values, mark, label=label)
    finish(tip, "time [s]", "tip above the rigid limit [mm]")
    finish(film, "time [s]", "film from its corners' surface [mm]")
    finish(by_size, "unknowns", "largest difference to the finest [mm]")
    finish(by_seconds, "run time [s]", "largest difference to the finest [mm]")
    save(figure, path)


if __name__ == "__main__":
    folder = Path("out/antenna_pendulum")
    results = {
        (p, n, m): main(cells=n, elements=m, order=p, output=folder / f"P{p} {n}x{n}-{m}")
        for p, n, m in RESOLUTIONS
    }
    if MPI.COMM_WORLD.rank == 0:
        plot(results, folder / "convergence.png")
        found = errors(results)
        print(
            "film  mesh     unknowns  tip - rigid  tip error  film deflection  film error [mm]  "
            "Newton/step  run [s]"
        )
        for (p, n, m), r in results.items():
            tip, film = (f"{1e3 * e:9.2f}" for e in found.get((p, n, m), (np.nan, np.nan)))
            print(
                f"P{p}    {f'{n}×{n}-{m}':8}{r['dofs']:9}{1e3 * r['deviation']:13.2f}{tip:>11}"
                f"{1e3 * r['film_deflection']:17.2f}{film:>17}"
                f"{r['newton_per_step']:13.1f}{r['seconds']:9.1f}"
            )
