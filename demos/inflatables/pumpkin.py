"""A pumpkin balloon is sewn from flat gores with tendons, and inflated: equilibria.

Flat gores stand around the axis, each bent along its length only, and apart.  Seams draw their
edges together; a tendon on each is shorter than the edge that it is sewn to.  Then the pressure
rises.  The film bulges between the tendons, and these take the shape of a film without hoop stress:
that of the mylar balloon, of half the length of a tendon.  At last the gas and the air around are
heavy: helium in air at sea level, 30 Pa above it at the foot and 40 Pa at the top.

Without hoop stress all tendons together bear one tension T from pole to pole, with the angle θ to
the axis, the pressure p over the air and the height z above the foot

    r' = sin θ,    z' = cos θ,    θ' = -2π r p(z)/T,    θ = -π/2 at the upper pole

and at the foot T cos θ is the lift, which the fixed pole holds.

Where the values come from:
    meridian           G. I. Taylor (1919); W. H. Paulsen, Amer. Math. Monthly 101 (1994) 953
    heavy gas          the equations of J. H. Smalley (NCAR 1964) with a pressure at the foot
    film               of the stiffness of thin polyethylene: 100 MPa, 20 µm
    sizes, pressures   chosen: 2 m from pole to pole along a gore, 100 Pa and 30 Pa
    densities          of air and helium at 288.15 K and an atmosphere
    tendons            chosen: 12 % shorter than the edges, strain of a thousandth under the load

    ./gossamer demo pumpkin
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.constants import g as standard_gravity
from scipy.integrate import quad, solve_ivp
from scipy.optimize import fsolve

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import draw_films, triangles
from gossamer_fx.extend import Array

# Radius over half the length of a meridian, of the mylar balloon.
RADIUS = 0.762759764
TENDON_FACTOR = 0.88
PRESSURE = 100.0  # Pa
# Share of the pressure that the film bears while it is sewn: without any it has no definite shape.
SEWING_PRESSURE = 0.01
FOOT_PRESSURE = 30.0  # of the heavy gas over the air at the lower pole [Pa]
AIR_DENSITY = 1.225  # kg/m³
HELIUM_DENSITY = 0.169  # kg/m³
# Rise of the pressure over that of the air with the height [Pa/m]
HEAD = (AIR_DENSITY - HELIUM_DENSITY) * standard_gravity
APART = 0.1  # m, of gores that are seen before they are sewn
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


def shape_by_hand() -> tuple[float, float]:
    """Largest radius [m], and tension [N] of all tendons together, of the balloon with heavy gas
    and so many tendons that the film bears no hoop stress."""
    length = 2 * TENDON_FACTOR

    def line(unknowns: Array) -> Array:
        angle, tension = unknowns
        found = solve_ivp(
            lambda s, y: (
                np.sin(y[2]),
                np.cos(y[2]),
                -2 * np.pi * y[0] * (FOOT_PRESSURE + HEAD * y[1]) / tension,
            ),
            (0.0, length),
            (0.0, 0.0, angle),
            rtol=1e-9,
            atol=1e-11,
            max_step=length / 200,
        )
        return np.asarray(found.y)

    def misses(unknowns: Array) -> tuple[float, float]:
        r, _, angle = line(unknowns)[:, -1]
        return r, angle + np.pi / 2

    guess = (np.pi / 2, FOOT_PRESSURE * np.pi * (TENDON_FACTOR * RADIUS) ** 2)
    unknowns = fsolve(misses, guess)
    return float(line(unknowns)[0].max()), float(unknowns[1])


@dataclass(frozen=True)
class Balloon:
    """A film of gores, its seams, tendons and fixed pole, and the search for their equilibria."""

    film: gx.Membrane
    seams: list[gx.Seam]
    tendons: list[gx.connectors.Tape]
    pole: gx.Fixed
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
        line = self.seams[0].lines(self.statics.system.unknowns.initial)[0]
        return line.positions(self.statics.system.unknowns.state)

    def radius(self) -> float:
        """Largest distance [m] of the first seam from the axis."""
        x = self.tendon_line()
        # Nothing keeps the axis upright: radii count from the line between the poles.
        axis = (x[-1] - x[0]) / np.linalg.norm(x[-1] - x[0])
        return float(np.linalg.norm(np.cross(x - x[0], axis), axis=1).max())

    def pull(self) -> float:
        """Tension [N] of all tendons together."""
        return sum(gx.probes.Tension(tendon)(self.statics) for tendon in self.tendons)

    def with_heavy_gas(self) -> Balloon:
        """The same balloon, from its present shape on, filled with helium in air."""
        foot = float(self.tendon_line()[0, 2])
        helium = gx.loads.UniformFluid(HELIUM_DENSITY, pressure=FOOT_PRESSURE, level=foot)
        air = gx.loads.UniformFluid(AIR_DENSITY, level=foot)
        scene = gx.Scene(
            self.film,
            gx.loads.FluidPressure(self.film, helium, side="inside"),
            gx.loads.FluidPressure(self.film, air, side="outside"),
            *self.seams,
            *self.tendons,
            self.pole,
            gx.StartFrom(self.statics.system),
        )
        return replace(self, statics=gx.Equilibrium(scene))


def build(
    comm: MPI.Intracomm, gores: int = 16, along: int = 16, across: int = 4, apart: float = APART
) -> Balloon:
    """The scene, with `along` cells from pole to pole of each gore and `across` cells from seam to
    seam; the gores are `apart` [m] farther from the axis at the start."""
    pattern = gx.patterns.gores(meridian(), gores)
    film = gx.Membrane(
        pattern.mesh(comm, along=along, across=across),
        FILM,
        displacement=lambda X: pattern.placed(X, apart=apart),
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
    return Balloon(film, seams, tendons, pole, gx.Equilibrium(scene))


def main(output: str | Path | None = None, gores: int = 16) -> dict[str, float]:
    """Shape and tendons over those of the constant-stress limit, without and with the weight of the
    gas; a picture in a folder `output`."""
    balloon = build(MPI.COMM_SELF, gores)
    shapes = {"flat gores, bent and apart": balloon.shape()}
    for t in (0.5, 1.0):
        balloon.statics.find(at=t)
    shapes["sewn, 1 Pa"] = balloon.shape()
    for t in (1.2, 2.0):
        balloon.statics.find(at=t)
    shapes["inflated, 100 Pa"] = balloon.shape()
    radius = balloon.radius()
    # At the equator all tendons together pull against the pressure on the circle.
    share = balloon.pull() / (PRESSURE * np.pi * radius**2)
    heavy = balloon.with_heavy_gas()
    heavy.statics.find()
    shape = heavy.shape()
    top_pressure = FOOT_PRESSURE + HEAD * float(np.ptp(shape[:, :, 2]))
    shapes[f"helium in air, {FOOT_PRESSURE:.0f} to {top_pressure:.0f} Pa"] = shape
    if output is not None:
        draw_films(shapes, Path(output) / "pumpkin.png", view=(24.0, -60.0), height=3.2)
    volume = gx.analysis.EnclosedVolume(heavy.film)(heavy.statics)
    force, _ = heavy.statics.reaction(heavy.pole)
    radius_by_hand, pull_by_hand = shape_by_hand()
    # Half way between two seams the film is farther from the axis by this.
    widest = np.linalg.norm(shape[:, :, :2], axis=2).max()
    return {
        "radius/limit": radius / (TENDON_FACTOR * RADIUS),
        "load in tendons": share,
        "lift/weight of air less gas": -float(force[2]) / (HEAD * volume),
        "sideways/lift": float(np.linalg.norm(force[:2])) / abs(float(force[2])),
        "heavy gas: radius/by hand": heavy.radius() / radius_by_hand,
        "heavy gas: tension/by hand": heavy.pull() / pull_by_hand,
        "heavy gas: pressure at the top [Pa]": top_pressure,
        "heavy gas: bulge between seams [m]": float(widest) - heavy.radius(),
    }


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print_figures(main(output="out/pumpkin"))
