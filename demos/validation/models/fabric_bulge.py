"""A clamped disc of coated fabric, which pressure bulges: heights and in-plane displacements.

A quarter of the disc is modelled as a flat film of order 2, clamped on its rim.  The wall is
isotropic with a linear relation between logarithmic strains and true stress,

    W = E t/(2(1-ν²)) [(ln λ1)² + (ln λ2)² + 2ν ln λ1 ln λ2],                                   (1)

as commercial codes have it for an elastic membrane at large strains, so that E t and ν mean what
they do for the peer.  The input "strain" chooses Green's strain instead.

E t is not an input.  The shape of the disc depends on p a/(E t) only, with the radius a, so that
one curve of heights is that of every wall.  E t is such that the mean logarithmic error of the
heights of *one* specimen vanishes, which are inputs; all specimens are predicted from it.

The disc need not be flat where it is free of stress.  The input "start_height" makes it a spherical
cap, and "start_profile" the surface of revolution of a measured profile, rows of radius and height.
A slack disc has such a shape, whose points are above those of the flat disc.  Heights are counted
from the plane of the rim, and in-plane displacements from the start shape.  The shape of the bulge
then depends on p a/(E t) and the start shape.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import ufl
from mpi4py import MPI
from scipy.interpolate import CubicSpline

import gossamer_fx as gx
from demos.common.searches import Effort
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.extend import Expr, IsotropicFilm, check
from gossamer_fx.meshes.disc import quarter_disc

# Numbers that a case may leave out, with the unit in which they are set then.
OPTIONAL_INPUTS = {"cells": "1", "start_height": "m"}

# Cells along the radius.
CELLS = 8
QUICK_CELLS = 2

# Loads p a/(E t) of the curve of heights: from walls twenty times as stiff as any that the heights
# of an experiment give, to a strain of 20 % at the top.  Heights in between are interpolated in
# logarithms, in which the curve is nearly a straight line.
LOADS = np.geomspace(5e-3, 0.4, 20)

# First load p a/(E t), some 0.2 Pa on a flat disc without stress: the search needs no other start.
# The height is then 3e-3 of the radius.
SLACK_LOAD = 1e-7

# Corrections of E t, each of which leaves a tenth of the error, and the relative error of E t.
MAX_CORRECTIONS = 30
STIFFNESS_TOLERANCE = 1e-6

# Points of the predicted lines from the centre to the rim.
POINTS = 21

# Points of the profile of a spherical cap.
PROFILE_POINTS = 41

# Splits E t into both and paces the pseudo-time of the equilibria; results do not depend on them.
THICKNESS = 1e-3  # [m]
DENSITY = 1e3  # [kg/m³]


@dataclass(frozen=True)
class Logarithmic(IsotropicFilm):
    """Isotropic film with the energy (1) of the module."""

    def energy(self, e: Expr, c: object) -> Expr:
        # Of the right Cauchy-Green tensor C = 1 + 2e, with the principal stretches λ1 and λ2
        trace = 2 + 2 * (e[0] + e[1])
        area_ratio = ufl.sqrt((1 + 2 * e[0]) * (1 + 2 * e[1]) - e[2] ** 2)
        sum_of_logarithms = ufl.ln(area_ratio)
        # ½(λ1/λ2 + λ2/λ1) - 1 = cosh(d) - 1 = x, with the difference d of the logarithms.  d² is a
        # smooth function of x, written as its series about equal stretches: its error is below 1e-6
        # of it where one stretch is up to 1.5 times the other.
        x = trace / (2 * area_ratio) - 1
        squared_difference = 2 * x - x**2 / 3 + 4 * x**3 / 45 - x**4 / 35 + 16 * x**5 / 1575
        product = (sum_of_logarithms**2 - squared_difference) / 4
        stiffness = c.E * c.thickness / (1 - c.nu**2)
        return stiffness / 2 * (sum_of_logarithms**2 - 2 * (1 - c.nu) * product)


@dataclass(frozen=True)
class Start:
    """A stress-free surface of revolution over the disc.

    Attributes:
        radii: distances from the axis (n,) [m], rising from 0 to the radius of the disc.
        heights: at these radii (n,) [m]; 0 on the rim.
    """

    radii: Array
    heights: Array

    @staticmethod
    def cap(radius: float, height: float) -> Start:
        """A spherical cap; a flat disc if its height is 0."""
        radii = np.linspace(0.0, radius, PROFILE_POINTS)
        if height == 0:
            return Start(radii, np.zeros(PROFILE_POINTS))
        sphere = (radius**2 + height**2) / (2 * height)
        return Start(radii, np.sqrt(sphere**2 - radii**2) - (sphere - height))

    @staticmethod
    def read(inputs: Inputs, radius: float) -> Start:
        """The start shape of a case file; a flat disc unless it has one."""
        if "start_profile" not in inputs:
            height = 0.0
            if "start_height" in inputs:
                height = inputs.number("start_height", "m")
            check(
                0 <= height < radius,
                f"{inputs.where}: start_height is {height:g} m; give one of at least 0 and below "
                f"the radius, {radius:g} m.",
            )
            return Start.cap(radius, height)
        radii, heights = inputs.table("start_profile", "m", columns=2).T
        is_profile = len(radii) > 2 and radii[0] == 0 and bool((np.diff(radii) > 0).all())
        check(
            is_profile and abs(radii[-1] - radius) < 1e-9 * radius and heights[-1] == 0,
            f"{inputs.where}: start_profile is not a profile; give rows of a rising radius and a "
            f"height, from radius 0 to {radius:g} m, where the height is 0.",
        )
        return Start(radii, heights)

    def height(self, x: Array, y: Array) -> Array:
        """Heights (n,) [m] over points (n,) of the disc, by a smooth curve that is flat on the
        axis."""
        curve = CubicSpline(self.radii, self.heights, bc_type=("clamped", "not-a-knot"))
        found: Array = curve(np.minimum(np.hypot(x, y), self.radii[-1]))
        return found

    def lift(self, mesh: gx.Mesh) -> None:
        """Move the points of a flat mesh of the disc up to the surface."""
        # Of ghosts, too: each rank moves all that it has.
        points = mesh.domain.geometry.x
        points[:, 2] = self.height(points[:, 0], points[:, 1])


LAWS = {"logarithmic": Logarithmic, "Green": gx.Linear}


def along_edge(values: Array, positions: Array) -> Array:
    """Values (n, 3) at positions (n,) from 0 to 1 along an edge of cells of order 2, by the
    parabolas through its nodes.

    Args:
        values: at the nodes (2 cells + 1, 3), which are evenly spaced.
        positions: along the edge.
    """
    cells = (len(values) - 1) // 2
    cell = np.minimum((positions * cells).astype(int), cells - 1)
    # From -1 to 1 over the cell.
    ξ = (2 * (positions * cells - cell) - 1)[:, None]
    first, middle, last = (values[2 * cell + k] for k in range(3))
    found: Array = ξ * (ξ - 1) / 2 * first + (1 - ξ**2) * middle + ξ * (ξ + 1) / 2 * last
    return found


class Bulge:
    """The equilibria of a quarter of a film under pressure, symmetric about x = 0 and y = 0.

    Args:
        film: the quarter, whose rim is in z = 0.
        clamped: names of its clamped edges.
        on_x, on_y: names of its edges on y = 0 and on x = 0.
        centre: name of its point at the origin.
    """

    def __init__(
        self, film: gx.Membrane, clamped: tuple[str, ...], on_x: str, on_y: str, centre: str
    ) -> None:
        scene = gx.Scene(
            gx.Pressure(film, lambda pressure: pressure),
            *(gx.Fixed(film, edge) for edge in clamped),
            gx.Fixed(film, on_x, components=(1,)),
            gx.Fixed(film, on_y, components=(0,)),
        )
        self._film = film
        self._centre = film.port(centre)
        self._search = gx.Equilibrium(scene)
        self.effort = Effort()
        self.unknowns = self._search.system.unknowns.numbering.size

    def heights(self, pressures: Array) -> Array:
        """Heights (n,) [m] of the centre under pressures (n,) [Pa], each found from the one
        before."""
        found = []
        for pressure in pressures.tolist():
            self.effort.add(self._search.find(at=pressure))
            found.append(float(self._search.system.unknowns.state.vector(self._centre)[2]))
        return np.array(found)

    def displacements(self, points: Array) -> Array:
        """Displacements (n, 3) [m] of nodes (n, 3) of the film free of stress in the state found
        last."""
        state = self._search.system.unknowns.state
        # The nearest nodes, as points of a curved film are known to its round-off only.
        ports = [self._film.port_at(point, snap=True) for point in points.tolist()]
        return np.array([state.vector(port) for port in ports]) - points


class Disc:
    """A disc and its heights under all loads.

    Args:
        radius: a [m].
        law: of the wall; of another E t pressures are multiplied by its ratio to this one.
        cells: along the radius.
        comm: the communicator.
        start: shape without stress; default: a flat disc.
    """

    def __init__(
        self,
        radius: float,
        law: IsotropicFilm,
        cells: int,
        comm: MPI.Intracomm,
        start: Start | None = None,
    ) -> None:
        mesh = quarter_disc(comm, cells, radius, order=2)
        if start is not None:
            start.lift(mesh)
        film = gx.Membrane(mesh, law, order=2, name="disc")
        self.bulge = Bulge(film, ("rim",), "x axis", "y axis", "centre")
        self.radius = radius
        # The pressure [Pa] at which p a/(E t) is one.
        self.unit_pressure = law.E * law.thickness / radius
        # A flat film has no stiffness across its plane without stress, which a small load gives it.
        self.slack_height = 0.0
        if start is None or not start.heights.any():
            slack = self.bulge.heights(np.array([SLACK_LOAD * self.unit_pressure]))
            self.slack_height = float(slack[0])
        self._heights = self.bulge.heights(LOADS * self.unit_pressure)

    def heights(self, loads: Array) -> Array:
        """Heights (n,) [m] of the centre under loads p a/(E t) (n,)."""
        check(
            bool((loads > LOADS[0]).all() and (loads < LOADS[-1]).all()),
            f"The loads p a/(E t) go from {loads.min():.2g} to {loads.max():.2g}; give pressures "
            f"for which they are between {LOADS[0]:g} and {LOADS[-1]:g}.",
        )
        return np.exp(np.interp(np.log(loads), np.log(LOADS), np.log(self._heights)))

    def stiffness(self, pressures: Array, heights: Array) -> float:
        """E t [N/m] for which the mean logarithmic error of the heights (n,) [m] vanishes."""
        stiffness = first_guess(self.radius, pressures, heights)
        for _ in range(MAX_CORRECTIONS):
            predicted = self.heights(pressures * self.radius / stiffness)
            error = float(np.log(predicted / heights).mean())
            # Heights are nearly proportional to the third root of the load.
            stiffness *= math.exp(3 * error)
            if abs(error) < STIFFNESS_TOLERANCE:
                break
        return stiffness


def first_guess(radius: float, pressures: Array, heights: Array) -> float:
    """E t [N/m] by h³ = 0.3 p a⁴/(E t), which holds for small heights."""
    return float(np.exp(np.log(0.3 * pressures * radius**4 / heights**3).mean()))


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Height [m] of the centre against pressure [Pa]; height and in-plane displacement [m] on both
    axes against the position on the flat disc [m]."""
    radius = inputs.number("radius", "m", above=0)
    poisson = inputs.number("poisson", "1")
    pressures = inputs.numbers("known_pressures", "Pa")
    heights = inputs.numbers("known_heights", "m")
    pressure = inputs.number("pressure", "Pa", above=0)
    check(
        len(pressures) == len(heights) > 1 and bool((pressures > 0).all() and (heights > 0).all()),
        f"{inputs.where}: give as many known_heights as known_pressures, all above 0.",
    )
    cells = QUICK_CELLS if quick else CELLS
    if "cells" in inputs:
        cells = inputs.whole("cells", least=2)
    law = LAWS[inputs.word("strain", tuple(LAWS))](
        E=first_guess(radius, pressures, heights) / THICKNESS,
        nu=poisson,
        density=DENSITY,
        thickness=THICKNESS,
    )
    start = Start.read(inputs, radius)
    disc = Disc(radius, law, cells, comm, start)
    stiffness = disc.stiffness(pressures, heights)

    shown = np.union1d(pressures, pressure)
    quantities = {"height of the top": Predicted(disc.heights(shown * radius / stiffness), shown)}
    half = np.linspace(0.0, radius, POINTS)
    position = np.concatenate([-half[:0:-1], half])
    load = pressure * radius / stiffness
    disc.bulge.heights(np.array([load * disc.unit_pressure]))
    # The mesh has an even number of cells along the radius.
    nodes = np.linspace(0.0, radius, 4 * max(round(cells / 2), 1) + 1)
    for component, axis in enumerate("xy"):
        points = np.zeros((len(nodes), 3))
        points[:, component] = nodes
        points[:, 2] = start.height(nodes, np.zeros(len(nodes)))
        displacements = disc.bulge.displacements(points)
        displacements[:, 2] += points[:, 2]
        moved = along_edge(displacements, half / radius)
        height = moved[:, 2]
        outward = moved[:, component]
        # The other half: heights are even functions of the position, in-plane displacements odd.
        whole_height = np.concatenate([height[:0:-1], height])
        whole_outward = np.concatenate([-outward[:0:-1], outward])
        quantities[f"height on {axis}"] = Predicted(whole_height, position)
        quantities[f"in-plane on {axis}"] = Predicted(whole_outward, position)
    details = {
        "stiffness [N/m]": stiffness,
        # Of a flat film.
        "height at the slack load [m]": disc.slack_height,
        "unknowns": float(disc.bulge.unknowns),
        "iterations": float(disc.bulge.effort.iterations),
        "seconds": disc.bulge.effort.seconds,
    }
    return Prediction(quantities, details)
