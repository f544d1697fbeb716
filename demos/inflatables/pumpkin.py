"""A pumpkin balloon is sewn from flat gores with tendons, and inflated: equilibria.

Flat gores stand around the axis, each bent along its length only, and apart.  Seams draw their
edges together; a tendon on each is shorter than the edge that it is sewn to.  Then the pressure
rises.  The film bulges between the tendons, and these take the shape of a film without hoop stress:
that of the mylar balloon, of half the length of a tendon.

Where the values come from:
    meridian           G. I. Taylor (1919); W. H. Paulsen, Amer. Math. Monthly 101 (1994) 953
    film               of the stiffness of thin polyethylene: 100 MPa, 20 µm
    sizes, pressure    chosen: 2 m from pole to pole along a gore, 100 Pa
    tendons            chosen: 12 % shorter than the edges, strain of a thousandth under the load

    ./gossamer demo pumpkin
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.integrate import quad

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import draw_films, triangles
from gossamer_fx.core.model.body import Array

# Radius over half the length of a meridian, of the mylar balloon.
RADIUS = 0.762759764
TENDON_FACTOR = 0.88
PRESSURE = 100.0  # Pa
# Share of the pressure that the film bears while it is sewn: without any it has no definite shape.
SEWING_PRESSURE = 0.01
APART = 0.1  # m, by which the gores are farther from the axis at the start
FILM = gx.Miyazaki(E=1e8, nu=0.3, density=920.0, thickness=2e-5, residual_stiffness=1e-4)


def meridian(points: int = 60) -> Array:
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


@dataclass(frozen=True)
class Balloon:
    """A film of gores, its seams and tendons, and the search for their equilibria."""

    film: gx.Membrane
    seams: list[gx.Seam]
    tendons: list[gx.connectors.Tape]
    statics: gx.Equilibrium

    def shape(self) -> Array:
        """Positions [m] of the corners of all triangles (n, 3, 3) of this rank about their
        middle."""
        corners = triangles(self.statics.system, self.film)
        high = corners.max(axis=(0, 1))
        low = corners.min(axis=(0, 1))
        return corners - (high + low) / 2

    def tendon_line(self) -> Array:
        """Positions (n, 3) [m] along the first seam."""
        line = self.seams[0].lines(self.statics.system.initial)[0]
        return line.positions(self.statics.system.state)


def build(comm: MPI.Intracomm, gores: int = 16, along: int = 16, across: int = 4) -> Balloon:
    """The scene, with `along` cells from pole to pole of each gore and `across` cells from seam to
    seam."""
    pattern = gx.patterns.gores(meridian(), gores)
    film = gx.Membrane(
        pattern.mesh(comm, along=along, across=across),
        FILM,
        displacement=lambda X: pattern.placed(X, apart=APART),
    )
    seams = pattern.seams(film)
    load = PRESSURE * np.pi * (TENDON_FACTOR * RADIUS) ** 2
    cord = gx.CableLaw(EA=1e3 * load / gores, line_density=1e-3)
    tendons = [
        gx.connectors.Tape.along_edges(
            film, cord, edges=f"left {k}", length_factor=TENDON_FACTOR, name=f"tendon {k}"
        )
        for k in range(gores)
    ]
    pressure = gx.Pressure(film, lambda t: PRESSURE * max(t - 1, SEWING_PRESSURE))
    pole = gx.Fixed(film, "first 0")
    scene = gx.Scene(film, pressure, *seams, *tendons, pole)
    return Balloon(film, seams, tendons, gx.Equilibrium(scene))


def main(output: str | Path | None = None, gores: int = 16) -> dict[str, float]:
    """Shape and tendons over those of the constant-stress limit; a picture in a folder `output`."""
    balloon = build(MPI.COMM_SELF, gores)
    shapes = {"flat gores, bent and apart": balloon.shape()}
    for t in (0.5, 1.0):
        balloon.statics.find(at=t)
    shapes["sewn, 1 Pa"] = balloon.shape()
    for t in (1.2, 2.0):
        balloon.statics.find(at=t)
    shapes["inflated, 100 Pa"] = balloon.shape()
    if output is not None:
        draw_films(shapes, Path(output) / "pumpkin.png", view=(24.0, -60.0), height=3.5)
    x = balloon.tendon_line()
    # Nothing keeps the axis upright: radii count from the line between the poles.
    axis = (x[-1] - x[0]) / np.linalg.norm(x[-1] - x[0])
    radius = float(np.linalg.norm(np.cross(x - x[0], axis), axis=1).max())
    # At the equator all tendons together pull against the pressure on the circle.
    pull = sum(gx.probes.Tension(tendon)(balloon.statics) for tendon in balloon.tendons)
    return {
        "radius/limit": radius / (TENDON_FACTOR * RADIUS),
        "load in tendons": pull / (PRESSURE * np.pi * radius**2),
    }


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print_figures(main(output="out/pumpkin"))
