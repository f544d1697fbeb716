"""An inflatable tube, pressed flat, is deployed in vacuum by gas from a small tank through a choked
orifice.

The film is the wrinkling membrane of Miyazaki (2006); tube and tank hold nitrogen, each with its
own mass, energy and volume, connected by an isentropic orifice.  Nothing acts from outside, so the
sum

    H = ½∫ρt|v|² dA + ∫W(E) dA + U_tube + U_tank,

with the energy that the film has lost, and the mass of the gas stay as they are at the start, while
the flow is choked at first, the film slaps open, and wrinkles and slack patches come and go.

Where the values come from:
    length 0.8 m       the long tube of the deployment tests in Miyazaki, KAKENHI 19360384 final
                       report (2009), §4(4)
    film               polyimide, Kapton HN 100 (DuPont data sheet H-38492): 25 µm, 2.5 GPa, 0.34,
                       1420 kg/m³
    diameter 58 mm     chosen: hoop stress 17 MPa at 15 kPa, a quarter of the film's yield strength
                       (69 MPa, data sheet)
    damping            a loss factor of 0.01 from 1 Hz to 100 kHz; assumed, see
                       `gossamer_fx.presets.films`.  `loss_factor=0` is without
    tank               chosen: 20 ml of nitrogen at 1.5 MPa and 293 K would fill the tube to about
                       15 kPa; it has 3 kPa at the end of the run
    valve              chosen: soft start, a bleed of 0.2 mm bore opens the tube, then a bore of 1
                       mm presses it up; discharge coefficient 0.8
    residual 1e-6      ratio of compressive to tensile stiffness; no result depends on it visibly

    ./gossamer demo inflate_tube        # 10254 unknowns, two minutes of CPU time
    ./gossamer run demos/inflatables/inflate_tube.py cells=14 --output out/tube
    ./gossamer report out/tube
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import effort, print_figures, run_case
from gossamer_fx.extend import Output, Schedule
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.presets.films import KAPTON_HN

TITLE = "A tube pressed flat, deployed from a tank"
LENGTH = 0.8  # m
DIAMETER = 0.058  # of the round tube [m]
FILM = gx.Miyazaki(E=2.5e9, nu=0.34, density=1420.0, thickness=25e-6, residual_stiffness=1e-6)
NITROGEN = gx.IdealGas(gamma=1.4, R=296.8)
BLEED = 0.2e-3  # diameter of the first opening of the valve [m]
BORE = 1e-3  # diameter of its main opening [m]
BAND = (1.0, 1e5)  # frequencies within which the loss factor of the film is constant [Hz]
SOFT = (0.02, 0.03)  # start and end of the opening of the main bore [s]


def valve_area(t: float) -> float:
    """Soft-start valve [m²]: a bleed opens the tube, then the main bore pressurises it."""
    opened = min(max((t - SOFT[0]) / (SOFT[1] - SOFT[0]), 0.0), 1.0)
    bore = BLEED + (BORE - BLEED) * opened**2 * (3 - 2 * opened)
    return math.pi * bore**2 / 4


class Table(Output):
    """Rows for people: the state of the run at a few instants."""

    def __init__(self, film: gx.Membrane, times: Sequence[float]) -> None:
        self._schedule = Schedule(times=tuple(times))
        self._columns: dict[str, Callable[[gx.Simulation], str]] = {
            "t [ms]": lambda run: f"{1e3 * run.time:.4g}",
            "p [Pa]": lambda run: f"{run.chamber('tube').pressure:.4g}",
            "T [K]": lambda run: f"{run.chamber('tube').temperature:.4g}",
            "V [l]": lambda run: f"{1e3 * run.chamber('tube').volume:.4g}",
            "gas [mg]": lambda run: f"{1e6 * run.chamber('tube').mass:.4g}",
        }
        for state in ("taut", "wrinkled", "slack"):
            share = gx.probes.AreaFraction(film, state)
            self._columns[state] = lambda run, share=share: f"{share(run):.1%}"
        self._columns["ledger"] = lambda run: f"{run.energy_error:+.0e}"
        self._columns["iterations"] = lambda run: f"{self._iterations_a_step(run):.1f}"
        self.rows = [tuple(self._columns)]
        # Steps and iterations until the last row.
        self._seen = (0, 0)

    @property
    def times(self) -> Sequence[float]:
        return self._schedule.times

    def _iterations_a_step(self, run: gx.Simulation) -> float:
        """Since the last row."""
        steps, iterations = self._seen
        self._seen = (run.step, run.iterations)
        return (run.iterations - iterations) / max(run.step - steps, 1)

    def open(self, run: gx.Simulation) -> None:
        """Nothing to prepare."""

    def record(self, run: gx.Simulation, last: bool) -> None:
        """Add a row if it is time for one."""
        if self._schedule.due(run.step, run.time, last, since=None):
            self.rows.append(tuple(column(run) for column in self._columns.values()))

    def close(self, run: gx.Simulation) -> None:
        """Print the table."""
        if run.comm.rank == 0:
            for row in self.rows:
                print("".join(word.rjust(11) for word in row))


def build(
    comm: MPI.Comm,
    cells: int = 14,
    until: float = 0.05,
    dt: float = 1e-4,
    loss_factor: float = KAPTON_HN.loss_factor or 0.0,
) -> gx.Case:
    """The tube of `cells` cells across, its tank and the valve, until the time `until` [s] in steps
    of `dt` [s]; `loss_factor` is that of the film, 0: none."""
    film = gx.Membrane(flat_tube(comm, LENGTH, DIAMETER, cells), FILM)
    tube = gx.Chamber(
        film, gas=NITROGEN, pressure=1.0, temperature=293.0, dead_volume=1e-6, name="tube"
    )
    tank = gx.Tank(20e-6, gas=NITROGEN, pressure=1.5e6, temperature=293.0)
    valve = gx.Orifice(tank, tube, area=valve_area, discharge_coefficient=0.8, name="valve")
    items: list[object] = [film, tube, valve]
    if loss_factor:
        items.append(gx.loads.flat_damping(film, loss_factor=loss_factor, band=BAND))
    return gx.Case(gx.Scene(*items), gx.Midpoint(dt=dt), until=until, title=TITLE)  # type: ignore[arg-type]


def main(
    cells: int = 14,
    until: float = 0.05,
    output: str | Path | None = None,
    dt: float = 1e-4,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Deploy a tube of `cells` cells across until the time `until` [s] in steps of `dt` [s]; state
    of the tube then.

    With `output`, a folder: the recording of the run, and a picture.
    """
    case = build(comm, cells, until, dt)
    film = next(body for body in case.scene.bodies if isinstance(body, gx.Membrane))
    looks = (0.04, 0.1, 0.2, 0.4, 0.7, 1.0)
    table = Table(film, np.linspace(0, until, 9)[1:].tolist())
    run, _ = run_case(replace(case, outputs=[table]), output, "tube", looks)
    state = run.chamber("tube")
    return {
        "time": run.time,
        "pressure": state.pressure,
        "temperature": state.temperature,
        "volume": state.volume,
        "mass": state.mass,
        **effort(run),
        "energy_error": abs(run.energy_error),
        "mass_error": abs(run.mass_error),
    }


if __name__ == "__main__":
    units = {"time": "s", "pressure": "Pa", "temperature": "K", "volume": "m³", "mass": "kg"}
    print_figures(main(output="out/inflate_tube"), units)
