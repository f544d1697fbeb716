"""A square pillow of two films is blown up from a tank: the first scene to try.

Two sheets of polyimide film, 0.2 m × 0.2 m × 25 µm, are joined along their edges and lie flat on each other.  Nitrogen
flows in through an orifice, choked at first; the film wrinkles towards the corners, and a little damping calms it.
Nothing else acts, so what the energy of film, gas and tank loses is what the damping takes, and no gas is lost.

Where the values come from:
    film, gas          `gossamer_fx.presets`, which names its sources
    sizes, tank        chosen: 4 ml at 1 MPa fill the pillow to 2 kPa, a film stress of some MPa
    orifice            chosen: 0.5 mm² empties the tank within 0.1 s
    damping            chosen: 100 1/s slows the whole, 1e-5 s the shortest waves

    ./gossamer demo pillow
    ./gossamer run demos/pillow.py cells=12 --output out/pillow; ./gossamer report out/pillow
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.presets.films import KAPTON_HN
from gossamer_fx.presets.gases import NITROGEN

TITLE = "A pillow blown up from a tank"


EDGE = 0.2  # m


def two_squares(model: Any, cells: int) -> None:
    """Two squares in z = 0 that share their rim, with `cells` triangles along an edge, as a gmsh model."""
    geo, a = model.geo, EDGE / 2
    corners = [geo.addPoint(x, y, 0) for x, y in ((-a, -a), (a, -a), (a, a), (-a, a))]
    rim = [geo.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    top, bottom = (geo.addPlaneSurface([geo.addCurveLoop(rim)]) for _ in range(2))
    for line in rim:
        geo.mesh.setTransfiniteCurve(line, cells + 1)
    for sheet in (top, bottom):
        geo.mesh.setTransfiniteSurface(
            sheet, "AlternateLeft"
        )  # no triangle has all its nodes on the rim
    geo.mesh.setReverse(2, bottom)  # normals point outwards
    geo.synchronize()
    for name, sheet in (("top", top), ("bottom", bottom)):
        model.addPhysicalGroup(2, [sheet], name=name)
    model.mesh.generate(2)


def build(comm: MPI.Intracomm, cells: int = 8, until: float = 0.1, dt: float = 5e-4) -> gx.Case:
    """The scene, with an even number of `cells` along an edge."""
    mesh = gx.gmsh_mesh(lambda model: two_squares(model, cells), comm)
    film = gx.Membrane(mesh, KAPTON_HN.law(25e-6))
    bag = gx.Chamber(film, gas=NITROGEN, pressure=10.0, temperature=293.0, dead_volume=1e-6)
    tank = gx.Tank(volume=4e-6, gas=NITROGEN, pressure=1e6, temperature=293.0)
    valve = gx.Orifice(tank, bag, area=5e-7, discharge_coefficient=0.8)
    rubbing = gx.Damping(film, mass_factor=100.0, stiffness_factor=1e-5)
    return gx.Case(
        gx.Scene(film, bag, valve, rubbing), gx.Midpoint(dt=dt), until=until, title=TITLE
    )


def main(
    comm: MPI.Intracomm, output: str | Path = "out/pillow", cells: int = 8, until: float = 0.1
) -> gx.Simulation:
    """Blow it up, with the ledger and pictures in the folder `output`.  Returns the simulation at its end."""
    folder, case = Path(output), build(comm, cells, until)
    picture = gx.plot.Picture(
        folder / "pillow.png", times=[0.1 * until, 0.3 * until, until], title=TITLE
    )
    run = case.simulation([gx.outputs.Progress(), gx.Ledger(folder / "ledger.csv"), picture])
    run.run(until=case.until)
    if comm.rank == 0:
        bag = run.chamber("chamber")
        print(
            f"pressure {bag.pressure:.0f} Pa, volume {bag.volume * 1e3:.3f} l, gas {bag.mass * 1e6:.2f} mg"
        )
        print(f"energy closes to {abs(run.energy_error):.0e}, mass to {abs(run.mass_error):.0e}")
    return run


if __name__ == "__main__":
    main(MPI.COMM_WORLD)
