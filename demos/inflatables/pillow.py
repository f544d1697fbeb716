"""A square pillow of two films is blown up from a tank: the first scene to try.

Two sheets of polyimide film, 0.2 m × 0.2 m × 25 µm, are joined along their edges and lie flat on
each other.  Nitrogen flows in through an orifice, choked at first.  The film wrinkles towards the
corners, and weak damping ends its vibrations.  No other load acts: the energy of film, gas and tank
decreases by the dissipated energy only, and the mass of the gas is constant.

Where the values come from:
    film, gas          `gossamer_fx.presets`, which names its sources
    sizes, tank        chosen: 4 ml at 1 MPa fill the pillow to 2 kPa, a film stress of some MPa
    orifice            chosen: 0.5 mm² empties the tank within 0.1 s
    damping            chosen: 100 1/s slows the whole, 1e-5 s the shortest waves

    ./gossamer demo pillow
    ./gossamer run demos/inflatables/pillow.py cells=12 --output out/pillow
    ./gossamer report out/pillow
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.presets.films import KAPTON_HN
from gossamer_fx.presets.gases import NITROGEN

TITLE = "A pillow blown up from a tank"
EDGE = 0.2  # of the squares [m]


def two_squares(model: Any, cells: int) -> None:
    """Two squares in z = 0 that share their rim, with `cells` triangles along an edge, as a gmsh
    model."""
    geo = model.geo
    half = EDGE / 2
    corners = [
        geo.addPoint(-half, -half, 0),
        geo.addPoint(half, -half, 0),
        geo.addPoint(half, half, 0),
        geo.addPoint(-half, half, 0),
    ]
    rim = [geo.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    top = geo.addPlaneSurface([geo.addCurveLoop(rim)])
    bottom = geo.addPlaneSurface([geo.addCurveLoop(rim)])
    for line in rim:
        geo.mesh.setTransfiniteCurve(line, cells + 1)
    for square in (top, bottom):
        # With this pattern no triangle has all its nodes on the rim, where it could not move.
        geo.mesh.setTransfiniteSurface(square, "AlternateLeft")
    # Normals of a closed film point outwards.
    geo.mesh.setReverse(2, bottom)
    geo.synchronize()
    model.addPhysicalGroup(2, [top], name="top")
    model.addPhysicalGroup(2, [bottom], name="bottom")
    model.mesh.generate(2)


def build(comm: MPI.Intracomm, cells: int = 8, until: float = 0.1, dt: float = 5e-4) -> gx.Case:
    """The scene, with an even number of `cells` along an edge."""
    mesh = gx.gmsh_mesh(lambda model: two_squares(model, cells), comm)
    film = gx.Membrane(mesh, KAPTON_HN.law(25e-6))
    bag = gx.Chamber(film, gas=NITROGEN, pressure=10.0, temperature=293.0, dead_volume=1e-6)
    tank = gx.Tank(volume=4e-6, gas=NITROGEN, pressure=1e6, temperature=293.0)
    valve = gx.Orifice(tank, bag, area=5e-7, discharge_coefficient=0.8)
    damping = gx.Damping(film, mass_factor=100.0, stiffness_factor=1e-5)
    scene = gx.Scene(film, bag, valve, damping)
    return gx.Case(scene, gx.Midpoint(dt=dt), until=until, title=TITLE)


def main(
    comm: MPI.Intracomm, output: str | Path = "out/pillow", cells: int = 8, until: float = 0.1
) -> gx.Simulation:
    """Inflate the pillow; write ledger and picture to the folder `output`; return the finished
    simulation."""
    folder = Path(output)
    case = build(comm, cells, until)
    times = [0.1 * until, 0.3 * until, until]
    picture = gx.plot.Picture(folder / "pillow.png", times=times, title=TITLE)
    run = case.simulation([gx.outputs.Progress(), gx.Ledger(folder / "ledger.csv"), picture])
    run.run(until=case.until)
    if comm.rank == 0:
        bag = run.chamber("chamber")
        print(
            f"pressure {bag.pressure:.0f} Pa, volume {bag.volume * 1e3:.3f} l, gas "
            f"{bag.mass * 1e6:.2f} mg"
        )
        print(f"energy closes to {abs(run.energy_error):.0e}, mass to {abs(run.mass_error):.0e}")
    return run


if __name__ == "__main__":
    main(MPI.COMM_WORLD)
