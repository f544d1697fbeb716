"""A pumpkin balloon is sewn from flat gores with tendons, and inflated.

Ten flat gores stand around the axis, each bent along its length only, and apart.  Seams draw their edges together; a
tendon on each is shorter than the edge that it is sewn to.  Then gas flows in.  The film bulges between the tendons,
and these take the shape of a film without hoop stress: that of the mylar balloon, of half the length of a tendon.

Where the values come from:
    meridian           G. I. Taylor (1919); W. H. Paulsen, Amer. Math. Monthly 101 (1994) 953
    film, gas          `gossamer_fx.presets`, which names its sources
    sizes, tank        chosen: 2 m from pole to pole along a gore, 100 Pa in the end
    tendons            chosen: 12 % shorter than the edges, strain of some thousandths under the load
    damping            chosen: what calms the panels while they are sewn

    ./gossamer demo pumpkin
    ./gossamer run demos/pumpkin.py gores=16 --output out/pumpkin; ./gossamer report out/pumpkin
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.integrate import quad

import gossamer_fx as gx
from gossamer_fx.presets.films import KAPTON_HN
from gossamer_fx.presets.gases import NITROGEN

TITLE = "A pumpkin balloon, sewn from flat gores and inflated"
# Radius over half the length of a meridian, of the mylar balloon.
RADIUS = 0.762759764
TENDON_FACTOR = 0.88
SEWN = 0.15  # s, from when on the seams are closed
APART = 0.12  # m, by which the gores are farther from the axis at the start


def meridian(points: int = 60) -> np.ndarray:
    """Radius and height [m] of the mylar balloon of two discs of 1 m radius, from pole to pole.

    With r = R sin θ, dz = R sin²θ/√(1 + sin²θ) dθ.
    """

    def slope(angle: float) -> float:
        return float(np.sin(angle) ** 2 / np.sqrt(1 + np.sin(angle) ** 2))

    angles = np.linspace(0, np.pi / 2, points)
    heights = RADIUS * np.array([quad(slope, 0, angle)[0] for angle in angles])
    radii = RADIUS * np.sin(angles)
    lower = np.stack([radii, heights - heights[-1]], axis=1)
    upper = np.stack([radii, heights[-1] - heights], axis=1)[::-1]
    return np.vstack([lower, upper[1:]])


def build(
    comm: MPI.Intracomm,
    gores: int = 10,
    along: int = 14,
    across: int = 4,
    until: float = 0.5,
    dt: float = 2e-3,
) -> gx.Case:
    """The scene, with `along` cells from pole to pole of each gore and `across` cells from seam to seam."""
    pattern = gx.patterns.gores(meridian(), gores)
    film = gx.Membrane(
        pattern.mesh(comm, along=along, across=across),
        KAPTON_HN.law(25e-6),
        displacement=lambda X: pattern.placed(X, apart=APART),
    )
    seams = pattern.seams(film, closing=(0.0, SEWN))
    load = 100.0 * np.pi * (TENDON_FACTOR * RADIUS) ** 2
    cord = gx.TensionOnly(EA=300 * load / gores, line_density=2e-3)
    tendons = [
        gx.connectors.Tape.along_edges(
            film, cord, edges=f"left {k}", length_factor=TENDON_FACTOR, name=f"tendon {k}"
        )
        for k in range(gores)
    ]
    bag = gx.Chamber(film, gas=NITROGEN, pressure=1.0, temperature=293.0, seams=seams)
    tank = gx.Tank(volume=1e-4, gas=NITROGEN, pressure=1e6, temperature=293.0)

    def opening(t: float) -> float:
        """Area of the valve [m²], which opens when the seams are closed."""
        return 5e-6 if t > SEWN else 0.0

    valve = gx.Orifice(tank, bag, area=opening, discharge_coefficient=0.8)
    rubbing = gx.Damping(film, mass_factor=30.0, stiffness_factor=1e-4)
    return gx.Case(
        gx.Scene(bag, *tendons, valve, rubbing), gx.Midpoint(dt=dt), until=until, title=TITLE
    )


def main(
    comm: MPI.Intracomm, output: str | Path = "out/pumpkin", gores: int = 10, until: float = 0.5
) -> gx.Simulation:
    """Sew and inflate it, with ledger and picture in the folder `output`.  Returns the simulation at its end."""
    folder = Path(output)
    case = build(comm, gores, until=until)
    picture = gx.plot.Picture(
        folder / "pumpkin.png", times=[0.0, SEWN, until], title=TITLE, view=gx.plot.View()
    )
    run = case.simulation([gx.outputs.Progress(), gx.Ledger(folder / "ledger.csv"), picture])
    run.run(until=case.until)
    if comm.rank == 0:
        bag = run.chamber("chamber")
        print(f"pressure {bag.pressure:.1f} Pa, volume {bag.volume:.3f} m³")
        print(f"energy closes to {abs(run.energy_error):.0e}, mass to {abs(run.mass_error):.0e}")
    return run


if __name__ == "__main__":
    main(MPI.COMM_WORLD)
