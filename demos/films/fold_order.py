"""Which fold comes first, and how do I start from a sheet that is folded twice?

A start needs no history of folding: the position of every point of the flat film is given, by a map
of `gx.fold` or by `displacement`.  The order is in the result, as the order of the layers, and in
what can move at the same time.

Folds that cross at right angles go one after the other.  Only when the first is shut, and all
layers lie on each other, can the second turn without stretching the film.  Halving a square along x
and then along y stacks its quarters as 10, 00, 01, 11 from top to bottom; along y first as 01, 00,
10, 11. The first fold made is the last to open.

Folds of a Miura sheet, whose lines are not at right angles, turn all at once.  `gx.fold.Miura` has
one angle θ, and the film is not stretched at any: its energy is round-off.

Layers must start apart.  `Contact` refuses a start in which they intersect or coincide, and the
probe `ContactGap` is the smallest gap.  A gap between shut layers costs strain where the outer
layer goes round the inner one.  The energies printed say so: with a second fold by a right angle
the film has 12 kJ while the first one is open by 90° (it would tear), and 0.3 J at 1°; a Miura
sheet has 1e-27 J. The gap of the quarters that are opened by 1° and 3° is 3 µm, next to the corner
where the folds cross.

Where the values come from:
    crossing folds     Gauss: a sheet that does not stretch is straight in one direction wherever it
                       bends
    Miura              Schenk & Guest (2013), doi:10.1073/pnas.1217998110
    film, size         polyimide of 25 µm, 0.2 m × 0.2 m

    ./gossamer demo fold_order
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import draw_films, triangles
from gossamer_fx.extend import Array
from gossamer_fx.meshes.sails import parallelograms
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.presets.films import KAPTON_HN

# A square of four quarters, named by their position along x and y.
EDGE = 0.2  # m
FILM = KAPTON_HN.law(25e-6)
QUARTERS = ("00", "10", "01", "11")


def halved(s: Array, height: Array, opening: float) -> tuple[Array, Array]:
    """A line folded in its middle: the second half is turned below the first one.

    Args:
        s: positions (n,) [m] along the flat line, from 0 to `EDGE`.
        height: distances (n,) [m] above the line, of layers that are folded with it.
        opening: angle [rad] between both halves; zero: the fold is shut.

    Returns:
        positions along the first half, and above it, (n,) each.
    """
    middle = EDGE / 2
    beyond = s - middle
    # Nodes on the fold itself belong to both halves.
    turned = beyond > 1e-9
    normal_along = np.where(turned, math.sin(opening), 0.0)
    normal_up = np.where(turned, -math.cos(opening), 1.0)
    # At the fold itself layers are apart along the line that bisects both normals.
    at_fold = np.abs(beyond) <= 1e-9
    normal_along = np.where(at_fold, math.cos(opening / 2), normal_along)
    normal_up = np.where(at_fold, math.sin(opening / 2), normal_up)
    # The turned half lies below the first one.
    along = np.where(turned, middle - beyond * math.cos(opening), s)
    up = np.where(turned, -beyond * math.sin(opening), 0.0)
    return along + height * normal_along, up + height * normal_up


def folded_twice(first: str, openings: tuple[float, float]) -> Callable[[Array], Array]:
    """Displacement of a square that is halved along `first`, "x" or "y", then along the other
    direction.

    Args:
        first: direction of the line that is folded first.
        openings: angles [rad] between the halves, of the first and of the second fold.
    """
    # The direction of each component of the position.
    a = "xy".index(first)
    b = 1 - a

    def displacement(X: Array) -> Array:
        x = np.zeros_like(X)
        # The second half goes below: its depth counts as height of the layers for the second fold.
        x[a], depth = halved(X[a], np.zeros_like(X[a]), openings[0])
        x[b], x[2] = halved(X[b], -depth, openings[1])
        return x - X

    return displacement


def build(comm: MPI.Intracomm, first: str, openings: tuple[float, float]) -> gx.Membrane:
    """The square film, folded twice."""
    return gx.Membrane(
        sheet(comm, 16, 16, EDGE, EDGE),
        FILM,
        displacement=folded_twice(first, openings),
    )


def miura(comm: MPI.Intracomm, theta: float) -> tuple[gx.Membrane, gx.fold.Miura]:
    """A sheet of 4 × 4 parallelograms, and its fold map with the angle θ [rad]."""
    # The same pattern as the mesh below: its edges lie on the fold lines.
    gamma = math.radians(60.0)
    folds = gx.fold.Miura(EDGE / 4, EDGE / 4, gamma=gamma, theta=theta)
    flat = parallelograms(comm, EDGE / 4, EDGE / 4, gamma, 4, 4, 2)
    return gx.Membrane(flat, FILM), folds


def at_start(*items: object) -> gx.Simulation:
    """A run that has not begun: its scene is compiled, and contact has checked the start."""
    return gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=1e-4))


def layers(film: gx.Membrane, run: gx.Simulation) -> list[str]:
    """Quarters of the square from top to bottom; the first figure counts along x."""
    X = film.space.tabulate_dof_coordinates()
    height = run.system.unknowns.state[film].local_positions()[:, 2]
    heights = {}
    for name in QUARTERS:
        # Inside of a quarter, away from the folds.
        lower = np.array([int(figure) for figure in name]) * EDGE / 2
        inside = (X[:, :2] > lower + 1e-6) & (X[:, :2] < lower + EDGE / 2 - 1e-6)
        heights[name] = height[inside.all(axis=1)].mean()
    return sorted(heights, key=lambda name: -heights[name])


def main(output: str | Path | None = None) -> dict[str, object]:
    """Orders of layers, smallest gaps [m] and energies [J] of starts; a picture in the folder
    `output`."""
    comm = MPI.COMM_SELF
    # Open by different angles, so that all four layers are apart.
    nearly_shut = (math.radians(1.0), math.radians(3.0))
    results: dict[str, object] = {}
    shapes = {}
    for first in ("x", "y"):
        film = build(comm, first, nearly_shut)
        contact = gx.Contact(film, distance=1e-4)
        run = at_start(film, contact)
        results[f"layers, {first} first"] = ", ".join(layers(film, run))
        results[f"gap, {first} first [m]"] = gx.probes.ContactGap(contact)(run)
    right_angle = math.radians(90.0)
    # The second fold is a right angle, which needs the first to be shut.
    for degrees in (90.0, 1.0):
        film = build(comm, "x", (math.radians(degrees), right_angle))
        run = at_start(film)
        energy = run.totals.stored[film.name]
        results[f"energy, first fold open by {degrees:g}° [J]"] = energy
        shapes[f"first fold open by {degrees:g}°: {energy:.0e} J"] = triangles(run.system, film)
    # Nearly shut, and half open.
    for degrees in (85.0, 45.0):
        film, folds = miura(comm, math.radians(degrees))
        contact = gx.Contact(film, distance=2e-3)
        run = at_start(film, folds.start(film), contact)
        energy = run.totals.stored[film.name]
        results[f"energy, Miura, θ = {degrees:g}° [J]"] = energy
        results[f"gap, Miura, θ = {degrees:g}° [m]"] = gx.probes.ContactGap(contact)(run)
        shapes[f"Miura, {degrees:g}°: {energy:.0e} J"] = triangles(run.system, film)
    if output is not None:
        draw_films(shapes, Path(output) / "fold_order.png", view=(20.0, 35.0))
    return results


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print_figures(main(output="out/fold_order"))
