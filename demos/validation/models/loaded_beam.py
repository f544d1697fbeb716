"""A cantilever beam under a dead force or torque at its tip, as other programs test their beams.

The beam begins at the origin along x; it is straight, or an arc in the plane of x and z.  Its
section is a rectangle with the first width along y, whose stiffnesses a test may replace.  An arc
is a polygon with one element a side, of which n and 2 n sides are extrapolated by 1/n², unless the
test gives the number of elements, as the source has it.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.extend import check
from gossamer_fx.meshes.line import line

ELEMENTS = 16
QUICK_ELEMENTS = 8

# Stiffnesses of a section that a test may give, with their units.
STIFFNESSES = {"EA": "N", "GA2": "N", "GA3": "N", "EI2": "N m2", "EI3": "N m2", "GJ": "N m2"}
# Numbers that a case may leave out, with the unit in which they are set then.
OPTIONAL_INPUTS = {"angle": "rad", "elements": "1", **STIFFNESSES}

DENSITY = 1000.0  # [kg/m³]; it only paces the search for the equilibrium


@dataclass(frozen=True)
class LoadedBeam:
    """A cantilever and its load in SI units.

    Attributes:
        section: its stiffnesses.
        length: of its axis.
        angle: that an arc turns by [rad]; 0 of a straight beam.
        load: "force" or "torque".
        vector: of the load, in space axes.
    """

    section: gx.sections.Section
    length: float
    angle: float
    load: str
    vector: Sequence[float]

    @classmethod
    def read(cls, inputs: Inputs) -> LoadedBeam:
        """The beam of a case file."""
        section = gx.sections.rectangle(
            inputs.number("width_y", "m", above=0),
            inputs.number("width_z", "m", above=0),
            E=inputs.number("E", "Pa", above=0),
            nu=inputs.number("poisson", "1"),
            density=DENSITY,
        )
        given = {
            name: inputs.number(name, unit, above=0)
            for name, unit in STIFFNESSES.items()
            if name in inputs
        }
        load = inputs.word("load", ("force", "torque"))
        vector = inputs.numbers("vector", "N" if load == "force" else "N m")
        check(len(vector) == 3, f"{inputs.where}: vector has {len(vector)} numbers; give three.")
        angle = inputs.number("angle", "rad") if "angle" in inputs else 0.0
        return cls(
            section=replace(section, **given),
            length=inputs.number("length", "m", above=0),
            angle=angle,
            load=load,
            vector=vector.tolist(),
        )

    def axis(self, sides: int) -> Array:
        """Points (n, 3) of the axis: the ends of a straight beam, the corners of an arc."""
        if self.angle == 0:
            return np.array([[0.0, 0.0, 0.0], [self.length, 0.0, 0.0]])
        radius = self.length / self.angle
        turned = np.linspace(0, self.angle, sides + 1)
        x = radius * np.sin(turned)
        z = radius * (1 - np.cos(turned))
        return np.column_stack([x, 0 * turned, z])

    def tip(self, elements: int, comm: MPI.Intracomm) -> tuple[Array, Array]:
        """Position of the tip (3,) before and under the load."""
        points = self.axis(elements)
        elements_a_side = elements // (len(points) - 1)
        axis = line(comm, points.tolist(), elements_a_side)
        beam = gx.Beam(axis, self.section, normal=(0, 1, 0))
        end = beam.port("end")
        load: gx.loads.Force | gx.loads.Torque = gx.loads.Force(end, self.vector)
        if self.load == "torque":
            load = gx.loads.Torque(beam.frame("end"), self.vector)
        search = gx.Equilibrium(gx.Scene(beam, gx.Fixed(beam, "start", rotation=True), load))
        search.find()
        return end.initial(), search.system.unknowns.state.vector(end)


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Position and displacement ux, uy, uz [m] of the tip."""
    begun = time.process_time()
    beam = LoadedBeam.read(inputs)
    elements = QUICK_ELEMENTS if quick else ELEMENTS
    if "elements" in inputs:
        elements = inputs.whole("elements")
    initial, tip = beam.tip(elements, comm)
    if beam.angle != 0 and "elements" not in inputs:
        _, finer = beam.tip(2 * elements, comm)
        tip = finer + (finer - tip) / 3
    moved = tip - initial
    quantities = {f"u{axis}": Predicted(float(moved[k])) for k, axis in enumerate("xyz")}
    quantities["tip position"] = Predicted(tip)
    return Prediction(quantities, {"seconds": time.process_time() - begun})
