"""What is a follower pressure, and what does its stiffness change?

`Pressure` acts along the normal of the deformed film, and so does the gas of a `Chamber`.  When the
film turns, the force turns with it: the linearised load is a stiffness, which the package always
includes.  A dead load keeps the direction that it had.
A ring (a slice of a long cylinder) of radius R and mass per area μ, without bending stiffness,
under the pressure p inside vibrates without stretching, n waves around, at

    ω² = p/(μ R) n² (n² - 1)/(n² + 1)        pressure follows: potential -p × enclosed volume
    ω² = p/(μ R) (n² - 1)²/(n² + 1)          dead load of the same size

n = 1 is a translation of the ring: ω = 0 in both.  The ratio n²/(n² - 1) of the stiffnesses, 4/3
for n = 2, is also that of the pressures outside at which a stiff ring buckles: 4 EI/R³ for a dead
load, 3 EI/R³ for a follower (M. Lévy, 1884).  A programme without pressure stiffness is wrong by
it.

The table printed compares natural frequencies of a film of triangles with both.  A gas of constant
mass in a `Chamber` adds its own stiffness for motions that change the volume; these do not.

Where the values come from:
    frequencies        second variation of hoop tension and enclosed area for w = cos nθ, v = -sin
                       nθ/n
    film, sizes        chosen: 25 µm of polyimide, R = 0.1 m, 1 kPa: hoop strain 1.6e-3

    ./gossamer demo follower_pressure
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import ufl
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import BLUE, RED, finish, new_figure, save
from gossamer_fx.extend import Array, Item, Load, State, Term, area_vector, constant
from gossamer_fx.meshes.tube_section import cylinder

# The hoop strain is p R/(E t) = 1.6e-3.
RADIUS = 0.1  # m
PRESSURE = 1e3  # Pa
FILM = gx.Linear(E=2.5e9, nu=0.3, density=1420.0, thickness=25e-6)
WAVES = (2, 3, 4, 5)


@dataclass(frozen=True, eq=False)
class DeadPressure(Item):
    """A pressure [Pa] along the normals of the mesh: it keeps size and direction as the film
    moves."""

    body: gx.Membrane
    pressure: float
    name: str = "dead pressure"

    def requires(self) -> Iterable[object]:
        """The film."""
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        """The work p n₀·w dA, which does not depend on the positions x of the film."""
        film = self.body
        p = constant(film.space.mesh, self.pressure)
        normal = area_vector(film.deformation(ufl.SpatialCoordinate(film.space.mesh)))
        yield Load(self.name, film, lambda x, w: p * ufl.dot(normal, w) * film.dx)


def build(comm: MPI.Intracomm, dead: bool = False, around: int = 48) -> gx.Equilibrium:
    """A free ring of `around` edges, whose points stay in their planes x = constant."""
    # Square cells.
    width = 2 * np.pi * RADIUS / around
    film = gx.Membrane(cylinder(comm, RADIUS, width, around, 1, order=2), FILM, order=2)
    # Both are loads of a film, with the same arguments.
    kind = DeadPressure if dead else gx.Pressure
    load = kind(film, PRESSURE)
    plane = gx.Fixed(film, "wall", components=(0,))
    return gx.Equilibrium(gx.Scene(film, load, plane))


def closed_form(n: Array, dead: bool = False) -> Array:
    """Frequency [Hz] of n waves around."""
    mass = FILM.density * FILM.thickness
    square = PRESSURE / (mass * RADIUS) * (n**2 - 1) / (n**2 + 1)
    square = square * (n**2 - 1) if dead else square * n**2
    return np.sqrt(square) / (2 * np.pi)


def frequencies(comm: MPI.Intracomm, dead: bool, around: int) -> Array:
    """Frequencies [Hz] of the film for the numbers `WAVES` of waves around."""
    ring = build(comm, dead, around)
    ring.find()
    # Two translations and a rotation come first, then each number of waves with two phases.
    found = gx.analysis.modes(ring, 3 + 2 * len(WAVES))
    return np.array([mode.frequency for mode in found[3::2]])


def draw(found: dict[str, Array], path: Path) -> None:
    """The mode of two waves with the forces of both loads, and frequencies against the number of
    waves."""
    figure = new_figure()
    ring, plot = figure.subplots(1, 2)
    # The mode of two waves, with an amplitude that can be seen.
    angle = np.linspace(0, 2 * np.pi, 200)

    def shape(θ: Array) -> Array:
        w = 0.3 * np.cos(2 * θ)
        v = -0.15 * np.sin(2 * θ)
        x = (1 + w) * np.cos(θ) - v * np.sin(θ)
        y = (1 + w) * np.sin(θ) + v * np.cos(θ)
        return np.stack([x, y])

    ring.plot(np.cos(angle), np.sin(angle), color="lightgrey")
    ring.plot(*shape(angle), color="black")
    places = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    along = shape(places + 1e-4) - shape(places - 1e-4)
    # Forces along the deformed normal, or along that of the circle.
    follower = 0.3 * np.stack([along[1], -along[0]]) / 2e-4
    dead_load = 0.3 * np.stack([np.cos(places), np.sin(places)])
    for force, colour, name in ((follower, BLUE, "follows"), (dead_load, RED, "dead load")):
        scale = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 4e-3}
        ring.quiver(*shape(places), *force, color=colour, label=name, **scale)
    ring.set(aspect="equal", xlim=(-1.7, 1.7), ylim=(-1.3, 1.3))
    ring.set_axis_off()
    ring.legend(frameon=False, loc="center")
    n = np.linspace(1, WAVES[-1], 100)
    for (name, values), colour in zip(found.items(), (BLUE, RED), strict=True):
        exact = closed_form(n, name == "dead")
        plot.plot(n, exact, color=colour, label=f"{name}: closed form")
        plot.plot(WAVES, values, "o", color=colour, label=f"{name}: film")
    plot.set(ylim=(0, None))
    finish(plot, "waves around, n", "frequency [Hz]")
    save(figure, path)


def main(
    output: str | Path | None = None, around: int = 48, comm: MPI.Intracomm = MPI.COMM_SELF
) -> dict[str, float]:
    """Frequencies over their closed form, and stiffness with over without pressure stiffness for n
    = 2."""
    found = {name: frequencies(comm, name == "dead", around) for name in ("follower", "dead")}
    if output is not None and comm.rank == 0:
        draw(found, Path(output) / "follower_pressure.png")
    results = {}
    for name, values in found.items():
        exact = closed_form(np.array(WAVES), name == "dead")
        for n, ratio in zip(WAVES, values / exact, strict=True):
            results[f"{name}, n = {n}, over closed form"] = float(ratio)
    results["stiffness, follower over dead, n = 2"] = float(
        # The stiffness goes with the square of the frequency.
        (found["follower"][0] / found["dead"][0]) ** 2
    )
    return results


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print_figures(main(output="out/follower_pressure"))
