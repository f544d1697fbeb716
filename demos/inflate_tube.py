"""An inflatable tube, pressed flat, is deployed in vacuum by gas from a small tank through a choked orifice.

The film is the wrinkling membrane of Miyazaki (2006); tube and tank hold nitrogen, each with its own mass, energy and
volume, connected by an isentropic orifice.  Nothing acts from outside, so the sum

    H = ½∫ρt|v|² dA + ∫W(E) dA + U_tube + U_tank

and the mass of the gas stay as they are at the start, while the flow is choked at first, the film slaps open, and
wrinkles and slack patches come and go.

Where the values come from:
    length 0.8 m       the long tube of the deployment tests in Miyazaki, KAKENHI 19360384 final report (2009), §4(4)
    film               polyimide, Kapton HN 100 (DuPont data sheet H-38492): 25 µm, 2.5 GPa, 0.34, 1420 kg/m³
    diameter 60 mm     chosen: 1 cm of slenderness for each of a 20 cm satellite's faces to pack; hoop stress 12 MPa at
                       10 kPa, a sixth of the film's yield strength
    tank               chosen: 20 ml of nitrogen at 1.5 MPa and 293 K fill the tube to about 10 kPa
    orifice            chosen: 1 mm bore, discharge coefficient 0.8, so that it takes 0.2 s
    residual 1e-6      ratio of compressive to tensile stiffness; no result depends on it visibly

    ./gossamer demo inflate_tube
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from meshes.tube import flat_tube

LENGTH, DIAMETER = 0.8, 0.06  # m
FILM = gx.Miyazaki(E=2.5e9, nu=0.34, density=1420.0, thickness=25e-6, residual=1e-6)
NITROGEN = gx.IdealGas(gamma=1.4, R=296.8)
BORE = 1e-3


def press_flat(x: np.ndarray) -> np.ndarray:
    """No displacement: the mesh is the flat tube."""
    return np.zeros_like(x)


def main(
    cells: int = 16,
    until: float = 0.2,
    output: str | Path | None = None,
    dt: float = 5e-4,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    film = gx.Membrane(flat_tube(comm, LENGTH, DIAMETER, cells), FILM)
    tube = gx.Chamber(film, gas=NITROGEN, pressure=1.0, temperature=293.0, dead_volume=1e-6, name="tube")
    tank = gx.Tank(20e-6, gas=NITROGEN, pressure=1.5e6, temperature=293.0)
    valve = gx.Orifice(tank, tube, area=math.pi * BORE**2 / 4, discharge_coefficient=0.8)
    outputs = [gx.Progress()]
    run = gx.Simulation(gx.Scene(film, tube, valve), gx.Midpoint(dt=dt), outputs)
    run.run(until=until)
    s = run.system.borders[0].states
    return {"p": s[0].p, "T":s[0].temperature,"V": s[0].V, "ptank": s[1].p, "its": run.iterations / run.step, "sub": run.substeps, "E": run.energy_error, "m": run.mass_error, "dofs": run.system.numbering.size, "seconds": run.seconds}


if __name__ == "__main__":
    print(main(output="out/inflate_tube"))
