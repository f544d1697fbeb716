"""The membrane antenna swings from one corner under g = 1 m/s² for two seconds.

The antenna of `demos/antenna_attitude.py`, horizontal and at rest, corner C on a ball joint.  Film and booms are so
stiff against this load that the tip A moves almost as in the rigid limit: for any masses of film and booms

    θ'' = (12 g/(7 d)) cos θ,    d = √2 · 2.1 m,    tip at depth d sin θ

(all masses on squares and diagonals of the same d give the same ratio of moment to inertia).  What depends on the
discretisation is the deviation from it, and the sag of the film between the booms.  The figures of the paper agree
with a commercial code within 0.02 m.

    ./gossamer demo antenna_pendulum
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.antenna_attitude import SIDE, antenna
from gossamer_fx.places import values_of

G = 1.0  # m/s²
RESOLUTIONS = ((2, 4), (3, 6), (4, 8), (6, 12), (8, 16))  # film cells, elements of a boom


def rigid_angle(t: np.ndarray, substeps: int = 200) -> np.ndarray:
    """θ(t) [rad] of the rigid limit from rest at θ = 0, by the classical Runge-Kutta rule between the given times."""
    rate = 12 * G / (7 * SIDE * 2**0.5)

    def slope(y: np.ndarray) -> np.ndarray:
        return np.array([y[1], rate * np.cos(y[0])])

    y, angles = np.zeros(2), [0.0]
    for h in np.repeat(np.diff(t) / substeps, substeps).reshape(-1, substeps):
        for k in h:
            k1 = slope(y)
            k2 = slope(y + k / 2 * k1)
            k3 = slope(y + k / 2 * k2)
            k4 = slope(y + k * k3)
            y = y + k / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        angles.append(y[0])
    return np.array(angles)


class Record:
    """Height of the tip, and how far the film's middle of an edge lies below the chord of its corners, at every step.

    Depth is along the normal of the rigid antenna, which the corners B, C, D span.
    """

    times: Sequence[float] = ()

    def __init__(self, corners: Sequence[gx.Port], edges: Sequence[gx.Port]) -> None:
        self._corners, self._edges = corners, edges
        self.rows: list[tuple[float, float, float]] = []

    def open(self, run: gx.Simulation) -> None:
        pass

    def record(self, run: gx.Simulation, last: bool) -> None:
        corners = values_of(run.system, self._corners, run.system.q0)
        edges = values_of(run.system, self._edges, run.system.q0)
        A, B, C, D = corners
        normal = np.cross(B - C, D - C)
        chords = (corners + np.roll(corners, -1, axis=0)) / 2
        sag = (chords - edges) @ normal / np.linalg.norm(normal)
        self.rows.append((run.time, float(A[2]), float(np.abs(sag).max())))

    def close(self, run: gx.Simulation) -> None:
        pass


def main(
    film_cells: int = 3,
    boom_elements: int = 6,
    until: float = 2.0,
    dt: float = 5e-3,
    order: int = 1,
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict:
    """Swing until `until` [s] with steps of `dt` [s]; heights and deflections in m over the time."""
    model = antenna(comm, film_cells, boom_elements, order)
    corners = [model.film.port_at(point) for point in model.points[:4]]
    middles = (model.points[:4] + np.roll(model.points[:4], -1, axis=0)) / 2
    edges = [model.film.port_at(point) for point in middles]
    record = Record(corners, edges)
    outputs: list = [gx.Progress(), record]
    if output is not None:
        outputs.append(gx.Ledger(Path(output) / f"ledger_{film_cells}_{boom_elements}.csv"))
    hinge = gx.BallJoint(corners[2], gx.Ground(tuple(model.points[2].tolist())), "hinge")
    weights = [gx.Gravity(body, (0, 0, -G)) for body in (model.film, *model.booms)]
    run = gx.Simulation(gx.Scene(*model.items, hinge, *weights), gx.Midpoint(dt=dt), outputs)
    run.run(until=until)

    table = np.array(record.rows)
    rigid = -SIDE * 2**0.5 * np.sin(rigid_angle(table[:, 0]))
    return {
        "time": table[:, 0],
        "tip": table[:, 1],
        "rigid_tip": rigid,
        "deviation": float(np.abs(table[:, 1] - rigid).max()),
        "film_deflection": float(table[:, 2].max()),
        "energy_error": run.energy_error,
        "newton_per_step": run.iterations / run.step,
        "substeps": run.substeps,
        "dofs": run.system.numbering.size,
        "seconds": run.seconds,
    }


def plot(results: dict[tuple[int, int], dict], path: Path) -> None:
    """Deviation from the rigid limit over the time, and the error of the tip against the finest resolution."""
    import matplotlib.pyplot as plt

    figure, (over_time, over_dofs) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    finest = results[max(results)]
    for (cells, elements), r in results.items():
        over_time.plot(r["time"], 1e3 * (r["tip"] - r["rigid_tip"]), label=f"{cells}×{cells}-{elements}")
    coarser = [r for r in results.values() if r is not finest]
    errors = [np.abs(r["tip"] - finest["tip"]).max() for r in coarser]
    over_dofs.loglog([r["dofs"] for r in coarser], errors, "o-")
    over_time.set(xlabel="time [s]", ylabel="tip above the rigid limit [mm]")
    over_dofs.set(xlabel="unknowns", ylabel="largest difference to the finest [m]")
    over_time.legend()
    figure.savefig(path)


if __name__ == "__main__":
    folder = Path("out/antenna_pendulum")
    results = {(n, m): main(film_cells=n, boom_elements=m, output=folder) for n, m in RESOLUTIONS}
    if MPI.COMM_WORLD.rank == 0:
        plot(results, folder / "convergence.png")
        for (n, m), result in results.items():
            scalars = {k: v for k, v in result.items() if np.ndim(v) == 0}
            print(f"{n}×{n}-{m}", "  ".join(f"{k} {v:.4g}" for k, v in scalars.items()))
