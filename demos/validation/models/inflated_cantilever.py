"""An inflated tube, clamped at one end, whose other end is closed and bears a transverse load.

Half of the tube is modelled, on one side of the plane of bending: a film of order 2 that bears no
compression, under constant pressure.  It is isotropic, unless the input "shear_stiffness" makes it
a woven one whose threads run along and around the tube.  The section at the clamped end does not
change; the other end is a rigid plate whose centre is lowered step by step, and the load is its
reaction.

The diameter of the input is that of the inflated tube.  The stretches of the stress-free tube
follow from

    λ_L/λ_H S_L = p r/2,    λ_H/λ_L S_H = p r,    S = E t/(1-ν²) (strains of Green)              (1)

The stiffness E t of the wall is not an input: it is such that the model has the measured slope n of
load against deflection at zero load, by the secant method from n L³/(3 π r³), which neglects shear.
All else is predicted: the load at larger deflections, the load at which the first cell wrinkles,
and the largest load, at which the tube collapses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.searches import Effort
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from demos.validation.models.braided_tube import (
    AXIAL,
    End,
    Lowered,
    half_tube_mesh,
    inflated_stretches,
    inflation,
)
from gossamer_fx.extend import STATES, check

# Numbers that a case may leave out, with the unit in which they are set then.
OPTIONAL_INPUTS = {"shear_stiffness": "N/m"}

# Cells over half of the section.
CELLS_AROUND = 12
QUICK_CELLS_AROUND = 6

# Steps of the deflection of the tip over the length of the tube.
STEP = 0.01
QUICK_STEP = 0.025

# Deflection over the length at which the slope is taken.
SLOPE_STEP = 1e-3

# Relative error of the slope at which the stiffness is found, and the largest number of
# corrections.
SLOPE_TOLERANCE = 1e-4
MAX_CORRECTIONS = 4

# Parts of a step of the deflection, one of which the first wrinkle is assigned to.
PARTS_OF_A_STEP = 8

# Distance from the ends, over the radius, up to which wrinkles do not count: the rigid plate and
# the clamp disturb the stress there.
END_ZONE = 1.0

# Mass per area [kg/m²]: it only paces the pseudo-time of the equilibria.
AREAL_MASS = 0.2
# Thickness [m] that splits E t into both; results do not depend on it.
THICKNESS = 1e-4


@dataclass(frozen=True)
class Cantilever:
    """The tube in SI units.

    Attributes:
        radius: of the inflated tube.
        length: of the inflated tube.
        pressure: held.
        stiffness: E t [N/m].
        poisson: ν.
        shear_stiffness: G t of a woven wall [N/m], or else that of an isotropic film.
    """

    radius: float
    length: float
    pressure: float
    stiffness: float
    poisson: float
    shear_stiffness: float | None = None

    def stretches(self) -> tuple[float, float]:
        """λ_L and λ_H of the inflated tube, equations (1) of the module."""
        plane = self.stiffness / (1 - self.poisson**2)
        hoop_force = self.pressure * self.radius
        stiffnesses = (plane, self.poisson * plane, plane)
        return inflated_stretches(stiffnesses, hoop_force / 2, hoop_force)

    def wall(self) -> gx.TensionField | gx.Orthotropic:
        """The film, which bears no compression."""
        if self.shear_stiffness is None:
            return gx.TensionField(
                E=self.stiffness / THICKNESS,
                nu=self.poisson,
                density=AREAL_MASS / THICKNESS,
                thickness=THICKNESS,
            )
        plane = self.stiffness / (1 - self.poisson**2)
        return gx.Orthotropic.from_stiffnesses(
            plane,
            self.poisson * plane,
            plane,
            self.shear_stiffness,
            thickness=THICKNESS,
            density=AREAL_MASS / THICKNESS,
            direction=AXIAL,
        )


class Bending:
    """The equilibria of a cantilever whose tip is lowered."""

    def __init__(self, tube: Cantilever, comm: MPI.Intracomm, around: int) -> None:
        λ_L, λ_H = tube.stretches()
        cells = max(round(tube.length / (math.pi * tube.radius / around)), 4)
        x = np.linspace(0.0, tube.length, cells + 1)
        # The band of this mesh is not used: it is one ring of the wall.
        mesh = half_tube_mesh(comm, x / λ_L, tube.radius / λ_H, around, (cells - 1, cells))
        inflate = inflation(tube.radius, λ_L, λ_H, around)
        film = gx.Membrane(mesh, tube.wall(), order=2, displacement=inflate, name="wall")
        end = End(film, None, np.array([tube.length, 0.0, 0.0]))
        self._load = Lowered(end.centre, 0.0)
        scene = gx.Scene(
            film,
            gx.Pressure(film, tube.pressure),
            end,
            gx.Fixed(film, "middle"),
            gx.Fixed(film, "plane", components=(1,)),
            gx.Fixed(film, "cap", components=(1,)),
            self._load,
        )
        self._search = gx.Equilibrium(scene)
        self._film = film
        zone = END_ZONE * tube.radius
        self._counted = (zone / λ_L, (tube.length - zone) / λ_L)
        self.effort = Effort()
        self.unknowns = self._search.system.unknowns.numbering.size

    def load(self, deflection: float) -> float:
        """The load of the whole tube [N] at a deflection of the tip [m], from the present state."""
        self.effort.add(self._search.find(at=deflection))
        return -2 * float(self._search.reaction(self._load)[0][2])

    def wrinkled_points(self) -> int:
        """Number of points of the wall, away from the ends, without tension in some direction.
        Collective."""
        points, state = gx.fields.field_values(self._search, self._film, field="state")
        begin, end = self._counted
        is_counted = (points[:, 0] > begin) & (points[:, 0] < end)
        here = int((state[is_counted] < STATES["taut"] - 0.5).sum())
        return self._film.comm.allreduce(here)


def stiff_as_measured(
    tube: Cantilever, slope: float, comm: MPI.Intracomm, around: int
) -> Cantilever:
    """The tube with the E t whose slope at zero load is the measured one [N/m].

    The slope of the model is nearly proportional to E t, so that each correction is by the ratio of
    the slopes.
    """
    step = SLOPE_STEP * tube.length
    for _ in range(MAX_CORRECTIONS):
        bending = Bending(tube, comm, around)
        ratio = slope / ((bending.load(step) - bending.load(0.0)) / step)
        tube = replace(tube, stiffness=tube.stiffness * ratio)
        if abs(ratio - 1) < SLOPE_TOLERANCE:
            break
    return tube


def first_wrinkle(bending: Bending, deflections: Array) -> float:
    """The load [N] at which the first cell wrinkles, from the inflated straight tube.

    Deflections only grow: a wrinkled film finds its taut state again from nearby only, so that a
    search backwards would find too small a load.

    Args:
        bending: the straight tube.
        deflections: of the test [m], rising, as far as the one at which wrinkles were seen, or one
            more.
    """
    # The inflated tube first: a search for the bent one from the stress-free shape would leave
    # wrinkles.
    taut_load = bending.load(float(deflections[0]))
    # A flat side of the mesh that covers the angle θ of the section becomes a parabola, along which
    # the hoop strain falls to θ²/24 below its mean.  Where θ²/24 exceeds the mean strain, points in
    # the middle of the sides are never taut: coarse meshes of stiff tubes have such points.
    in_straight_tube = bending.wrinkled_points()
    for before, after in pairwise(deflections):
        for deflection in np.linspace(before, after, PARTS_OF_A_STEP + 1)[1:]:
            load = bending.load(float(deflection))
            if bending.wrinkled_points() > in_straight_tube:
                # Between the last taut and the first wrinkled state.
                return (taut_load + load) / 2
            taut_load = load
    return taut_load


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Load [N] against deflection [m], the first wrinkle and the collapse."""
    radius = inputs.number("diameter", "m", above=0) / 2
    length = inputs.number("length", "m", above=0)
    slope = inputs.number("slope", "N/m", above=0)
    read_at = inputs.numbers("read_at", "m")
    last_deflection = inputs.number("deflection", "m", above=0)
    poisson = inputs.number("poisson", "1")
    check(
        -1 < poisson <= 0.5,
        f"{inputs.where}: poisson is {poisson:g}; give a number above -1 and not above 0.5.",
    )
    check(
        radius < length / 2,
        f"{inputs.where}: diameter is {2 * radius:g} m and length {length:g} m; give a tube that "
        "is longer.",
    )
    check(
        last_deflection < length and bool(np.all(read_at <= last_deflection)),
        f"{inputs.where}: deflection is {last_deflection:g} m; let it be below the length, "
        f"{length:g} m, and "
        "not below those of read_at.",
    )
    shear_stiffness = None
    if "shear_stiffness" in inputs:
        shear_stiffness = inputs.number("shear_stiffness", "N/m", above=0)
    tube = Cantilever(
        radius=radius,
        length=length,
        pressure=inputs.number("pressure", "Pa", above=0),
        stiffness=slope * length**3 / (3 * math.pi * radius**3),
        poisson=poisson,
        shear_stiffness=shear_stiffness,
    )
    around = QUICK_CELLS_AROUND if quick else CELLS_AROUND
    tube = stiff_as_measured(tube, slope, comm, around)
    bending = Bending(tube, comm, around)
    count = math.ceil(last_deflection / (length * (QUICK_STEP if quick else STEP)))
    deflections = np.union1d(np.linspace(0.0, last_deflection, count + 1), read_at)
    loads = []
    step_of_wrinkles = 0
    in_straight_tube = 0
    for k, deflection in enumerate(deflections):
        loads.append(bending.load(float(deflection)))
        wrinkled = bending.wrinkled_points()
        if k == 0:
            in_straight_tube = wrinkled
        if step_of_wrinkles == 0 and wrinkled > in_straight_tube:
            step_of_wrinkles = k
    curve = np.array(loads)
    quantities = {
        "load": Predicted(curve, deflections),
        "collapse load": Predicted(float(curve.max())),
        "deflection at collapse": Predicted(float(deflections[curve.argmax()])),
    }
    for deflection in read_at:
        load = float(np.interp(deflection, deflections, curve))
        quantities[f"load at {1e3 * deflection:g} mm"] = Predicted(load)
    if step_of_wrinkles:
        # One step more: after a large step a cell may have wrinkled too early.
        seen = deflections[: step_of_wrinkles + 2]
        quantities["first wrinkle"] = Predicted(first_wrinkle(Bending(tube, comm, around), seen))
    details = {
        "stiffness [N/m]": tube.stiffness,
        "unknowns": float(bending.unknowns),
        "iterations": float(bending.effort.iterations),
        "seconds": bending.effort.seconds,
    }
    return Prediction(quantities, details)
