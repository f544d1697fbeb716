"""A clamped disc of coated fabric, which pressure bulges: heights and in-plane displacements.

A quarter of the disc is modelled as a flat film of order 2, clamped on its rim.  The wall is
isotropic with a linear relation between logarithmic strains and true stress,

    W = E t/(2(1-ν²)) [(ln λ1)² + (ln λ2)² + 2ν ln λ1 ln λ2],                                   (1)

as commercial codes have it for an elastic membrane at large strains, so that E t and ν mean what
they do for the peer.  The input "strain" chooses Green's strain instead.

E t is not an input.  The shape of the disc depends on p a/(E t) only, with the radius a, so that
one curve of heights is that of every wall.  E t is such that the mean logarithmic error of the
heights of *one* specimen vanishes, which are inputs; all specimens are predicted from it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import ufl
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.searches import Effort
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.extend import Expr, IsotropicFilm, check
from gossamer_fx.meshes.disc import quarter_disc

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


LAWS = {"logarithmic": Logarithmic, "Green": gx.Linear}


class Bulge:
    """The equilibria of a quarter of a flat film under pressure, symmetric about x = 0 and y = 0.

    Args:
        film: the quarter, flat in z = 0.
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
        """Displacements (n, 3) [m] of points (n, 3) of the flat film in the state found last."""
        state = self._search.system.unknowns.state
        ports = [self._film.port_at(point) for point in points.tolist()]
        return np.array([state.vector(port) for port in ports]) - points


class Disc:
    """A disc and its heights under all loads.

    Args:
        radius: a [m].
        law: of the wall; of another E t pressures are multiplied by its ratio to this one.
        cells: along the radius.
        comm: the communicator.
    """

    def __init__(self, radius: float, law: IsotropicFilm, cells: int, comm: MPI.Intracomm) -> None:
        film = gx.Membrane(quarter_disc(comm, cells, radius, order=2), law, order=2, name="disc")
        self.bulge = Bulge(film, ("rim",), "x axis", "y axis", "centre")
        self.radius = radius
        # The pressure [Pa] at which p a/(E t) is one.
        self.unit_pressure = law.E * law.thickness / radius
        # The first state is that of a flat film without stress.
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
    disc = Disc(radius, law, cells, comm)
    stiffness = disc.stiffness(pressures, heights)

    shown = np.union1d(pressures, pressure)
    quantities = {"height of the top": Predicted(disc.heights(shown * radius / stiffness), shown)}
    half = np.linspace(0.0, radius, POINTS)
    position = np.concatenate([-half[:0:-1], half])
    load = pressure * radius / stiffness
    disc.bulge.heights(np.array([load * disc.unit_pressure]))
    for component, axis in enumerate("xy"):
        points = np.zeros((POINTS, 3))
        points[:, component] = half
        moved = disc.bulge.displacements(points)
        height = moved[:, 2]
        outward = moved[:, component]
        # The other half: heights are even functions of the position, in-plane displacements odd.
        whole_height = np.concatenate([height[:0:-1], height])
        whole_outward = np.concatenate([-outward[:0:-1], outward])
        quantities[f"height on {axis}"] = Predicted(whole_height, position)
        quantities[f"in-plane on {axis}"] = Predicted(whole_outward, position)
    details = {
        "stiffness [N/m]": stiffness,
        "height at the slack load [m]": disc.slack_height,
        "unknowns": float(disc.bulge.unknowns),
        "iterations": float(disc.bulge.effort.iterations),
        "seconds": disc.bulge.effort.seconds,
    }
    return Prediction(quantities, details)
