"""The orifice and the tank with which a tube opens at a wanted time and has a wanted pressure, by
gradients of runs.

A tube of 0.25 m, pressed flat, is blown up from a tank through an orifice.  It counts as open when
half of the volume of the round tube is enclosed.  Two numbers are looked for, the area A of the
orifice and the pressure p of the tank, such that

    T(A, p) = T*,    P(A, p) = P*

with the time T of the opening and the pressure P at the end.  Each run gives T and P, and one pass
backwards through its steps their derivatives with respect to both numbers.  Newton's method in the
logarithms of A and p, which keeps them positive, takes four runs here.

Neighbouring runs separate, as the film flutters while it slaps open.  The damping is strong enough
here for a derivative through the whole opening to predict finite changes: `growth` is printed.

Where the values come from:
    length 0.25 m      the short tube of the deployment tests in Miyazaki, KAKENHI 19360384 final
                       report (2009), §4(4)
    film               polyimide, Kapton HN 100 (DuPont data sheet H-38492): 25 µm, 2.5 GPa, 0.34,
                       1420 kg/m³
    diameter 30 mm     chosen, as are the tank of 0.1 ml and the damping
    wanted             half open after 0.9 ms, 1.5 kPa after 12 ms

    ./gossamer demo opening_time
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import finish, new_figure, save
from gossamer_fx.extend import Array
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.presets.films import KAPTON_HN
from gossamer_fx.presets.gases import NITROGEN

LENGTH = 0.25  # m
DIAMETER = 0.03  # m
TANK_VOLUME = 1e-7  # m³
ROUND = math.pi * DIAMETER**2 / 4 * LENGTH  # m³
NAMES = ("orifice.area", "tank.pressure")


@dataclass(frozen=True)
class Opening:
    """What a run gives.

    Attributes:
        time: at which half of the round volume is enclosed [s].
        pressure: at the end [Pa].
        slopes: derivatives of both with respect to the logarithms of area and tank pressure (2, 2).
        growth: see `gx.analysis.Gradient`.
        curve: times [s] and enclosed volumes [m³] of all steps (2, n).
    """

    time: float
    pressure: float
    slopes: Array
    growth: float
    curve: Array


def build(
    comm: MPI.Comm,
    area: float = 1e-7,
    pressure: float = 4e6,
    cells: int = 4,
    damping: float = 2e-5,
) -> tuple[gx.Scene, gx.Membrane, gx.Chamber]:
    """The tube, an orifice of this area [m²], and a tank with this pressure [Pa]."""
    film = gx.Membrane(flat_tube(comm, LENGTH, DIAMETER, cells), KAPTON_HN.law(25e-6))
    tube = gx.Chamber(
        film, gas=NITROGEN, pressure=50.0, temperature=293.0, dead_volume=1e-6, name="tube"
    )
    tank = gx.Tank(TANK_VOLUME, gas=NITROGEN, pressure=pressure, temperature=293.0)
    scene = gx.Scene(
        gx.Damping(film, mass_factor=200.0, stiffness_factor=damping),
        gx.Orifice(tank, tube, area=area, discharge_coefficient=0.8),
        gx.Fixed(film, "inlet"),
    )
    return scene, film, tube


def opening(comm: MPI.Comm, area: float, pressure: float, until: float, cells: int) -> Opening:
    """Run, and take the derivatives back through the steps."""
    scene, film, tube = build(comm, area=area, pressure=pressure, cells=cells)
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-4), outputs=[])
    tape = gx.analysis.RunTape(run)
    volume = gx.analysis.EnclosedVolume(film)
    curve = [(0.0, volume(run))]

    def record(run: gx.Simulation) -> None:
        curve.append((run.system.unknowns.time, volume(run)))

    steps = round(until / 1e-4)
    for k in range(steps):
        run.run(until=(k + 1) * until / steps)
        record(run)
    opened = gx.analysis.gradient(
        tape, of=gx.analysis.CrossingTime(volume, ROUND / 2), by=list(NAMES)
    )
    filled = gx.analysis.gradient(tape, of=gx.analysis.ChamberPressure(tube), by=list(NAMES))
    scales = (area, pressure)
    slopes = np.array(
        [
            [found[name].values[0] * scale for name, scale in zip(NAMES, scales, strict=True)]
            for found in (opened, filled)
        ]
    )
    return Opening(
        time=opened.value,
        pressure=filled.value,
        slopes=slopes,
        growth=opened.growth or 1.0,
        curve=np.array(curve).T,
    )


def main(
    wanted_time: float = 0.9e-3,
    wanted_pressure: float = 1.5e3,
    until: float = 12e-3,
    cells: int = 4,
    runs: int = 8,
    tolerance: float = 1e-4,
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Find both numbers; with `output`, a folder, a picture of the runs."""
    began = time.process_time()
    numbers = np.log([1e-7, 4e6])
    found: list[Opening] = []
    wanted = np.array([wanted_time, wanted_pressure])
    for _ in range(runs):
        area, pressure = np.exp(numbers)
        found.append(opening(comm, area, pressure, until, cells))
        error = np.array([found[-1].time, found[-1].pressure]) - wanted
        if comm.rank == 0:
            print(
                f"A = {1e6 * area:.4f} mm², tank {pressure / 1e3:.2f} kPa: open after "
                f"{1e3 * found[-1].time:.4f} ms, "
                f"{found[-1].pressure:.1f} Pa at the end; growth {found[-1].growth:.2g}"
            )
        if (abs(error) < tolerance * wanted).all():
            break
        # Two equations for two numbers.  The least squares of `gx.analysis.fit_runs` take ten runs
        # of the test's coarser tube, this takes four: time and pressure depend on both numbers
        # almost alike, so that steps along a sum of squares are short.
        update = -np.linalg.solve(found[-1].slopes, error)
        # Far from the solution the slopes are others: no number changes by more than a factor of e.
        numbers += update / max(1.0, abs(update).max())
    if output is not None and comm.rank == 0:
        draw(found, wanted_time, Path(output) / "opening_time.png")
    return {
        "orifice_mm2": float(1e6 * area),
        "tank_kPa": float(pressure / 1e3),
        "time_error": float(abs(error[0]) / wanted_time),
        "pressure_error": float(abs(error[1]) / wanted_pressure),
        "runs": len(found),
        "growth": found[-1].growth,
        "seconds": time.process_time() - began,
    }


def draw(found: Sequence[Opening], wanted_time: float, path: Path) -> None:
    """Enclosed volume over time of the runs, and the distance of each from what is wanted."""
    figure = new_figure(9.9, 3.96)
    volumes, errors = figure.subplots(1, 2)
    for k, one in enumerate(found):
        shade = 0.75 * (1 - (k + 1) / len(found))
        time_ms, share = 1e3 * one.curve[0], one.curve[1] / ROUND
        volumes.plot(time_ms, share, color=str(shade), lw=1 + k / len(found), label=f"run {k + 1}")
    volumes.plot([1e3 * wanted_time], [0.5], "o", color="tab:red", label="wanted")
    finish(volumes, "t [ms]", "volume over that of the round tube")
    numbers = np.arange(1, len(found) + 1)
    deviations = [abs(one.time - wanted_time) / wanted_time for one in found]
    errors.semilogy(numbers, deviations, "o-", color="black")
    errors.set_xticks(numbers)
    finish(errors, "run", "error of the opening time, relative")
    save(figure, path)


if __name__ == "__main__":
    print_figures(main(output="out/opening_time"))
