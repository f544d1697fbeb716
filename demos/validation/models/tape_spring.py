"""A tape spring bent against its curvature: the steady moment of its fold.

The tape is a plate on a flat mesh whose rest curvature makes it a circular arc across.  Its ends retain
their shape and are turned by φ each, without axial force, so that the centres of curvature along and
across are on different sides of the tape; by symmetry a half is computed.  The moment is M = dU/d(2φ) of
the stored energy U, after the snap from a straight line through the turns of the fold.

A fold that is a cylinder of the radius of the section has M = (1 + ν) D α.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.meshes.sheet import sheet

CELLS_ACROSS = 6
QUICK_CELLS_ACROSS = 4
# Length of a cell over its width.
CELL_ASPECT = 2.2
# Half of the length over the width of the tape.
HALF_LENGTH = 4.0

# Turns [rad]: the tape snaps near 5 degrees.  Beyond some 20 degrees the fold is longer than a cell and
# jumps along the mesh.
TURNS = np.radians(np.arange(0.0, 19.0, 1.0))
# Turn [rad] from which the moment is that of the fold.
STEADY_FROM = math.radians(13.0)

# Axial force over D α/R that counts as zero, and secant iterations for the shift [m] of the end.
LITTLE_FORCE = 2e-3
MAX_SECANT_STEPS = 12
# Largest change of the shift in one of them, over the radius: against steps over the snap.
MAX_SHIFT = 0.15

DENSITY = 7850.0  # [kg/m³]: it only paces the pseudo-time of the equilibria
SEARCH = gx.analysis.Continuation(
    first_step=1e-3, tolerance=1e-6, inner_tolerance=0.3, fast_iterations=15, max_iterations=40
)


@dataclass(frozen=True)
class Tape:
    """A tape in SI units: radius and angle of the section, and a plate's law."""

    radius: float
    angle: float
    law: gx.Linear

    @property
    def width(self) -> float:
        """Length of the section along its arc [m]."""
        return self.radius * self.angle

    @property
    def bending_stiffness(self) -> float:
        """D [N m]."""
        return self.law.E * self.law.thickness**3 / 12 / (1 - self.law.nu**2)


class Turning:
    """The equilibria of a half tape whose end is turned."""

    def __init__(self, tape: Tape, comm: MPI.Intracomm, across: int) -> None:
        R = tape.radius
        α = tape.angle
        length = HALF_LENGTH * tape.width
        mean_height = R * (1 - math.sin(α / 2) / (α / 2))
        self._shift = 0.0
        self._little = LITTLE_FORCE * tape.bending_stiffness * α / R
        self._max_shift = MAX_SHIFT * R
        # First guess of the axial stiffness [N/m]: that of a straight strip.
        self._stiffness = tape.law.E * tape.law.thickness * tape.width / length

        def section(X: Array) -> tuple[Array, Array]:
            a = X[1] / R - α / 2
            return R * (np.sin(a) + α / 2) - X[1], R * (1 - np.cos(a))

        def curved(X: Array) -> Array:
            y, z = section(X)
            return np.stack([0 * y, y, z])

        def turned(X: Array, φ: float) -> Array:
            y, z = section(X)
            above = z - mean_height
            x = self._shift + above * math.sin(φ)
            return np.stack([x, y, mean_height + above * math.cos(φ)])

        def direction(X: Array, φ: float) -> Array:
            ones = np.ones_like(X[0])
            return np.stack([math.cos(φ) * ones, 0 * ones, -math.sin(φ) * ones])

        along = round(across * HALF_LENGTH / CELL_ASPECT)
        mesh = sheet(comm, along, across, length, tape.width, crossed=True)
        self.plate = gx.Plate(
            mesh, tape.law, rest_curvature=np.diag((0.0, 1 / R, 0.0)), displacement=curved
        )
        middle = gx.Fixed(
            self.plate,
            "left",
            rotation=True,
            components=(0,),
            direction=(1.0, 0.0, 0.0),
            name="middle",
        )
        self._end = gx.Fixed(
            self.plate, "right", rotation=True, direction=direction, motion=turned, name="end"
        )
        self._search = gx.Equilibrium(gx.Scene(self.plate, middle, self._end), SEARCH)
        self._tape = tape
        self.unknowns = self._search.system.numbering.size
        self.iterations = 0
        self.seconds = 0.0

    def energy(self, φ: float) -> float:
        """Stored energy of both halves [J] at a turn without axial force."""
        force_before = math.nan
        step = 0.0
        for _ in range(MAX_SECANT_STEPS):
            found = self._search.find(at=φ)
            self.iterations += found.iterations
            self.seconds += found.seconds
            force = float(self._search.reaction(self._end)[0][0])
            if math.isfinite(force_before) and force != force_before:
                secant = (force - force_before) / step
                # Past the snap a secant may be negative and lead away.
                if secant > 1e-3 * self._stiffness:
                    self._stiffness = secant
            if abs(force) < self._little:
                break
            force_before = force
            step = float(np.clip(-force / self._stiffness, -self._max_shift, self._max_shift))
            self._shift += step
        return 2 * float(sum(found.totals.stored.values()))


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Steady and largest moment [N m]."""
    law = gx.Linear(
        E=inputs.number("E", "Pa", above=0),
        nu=inputs.number("poisson", "1"),
        density=DENSITY,
        thickness=inputs.number("thickness", "m", above=0),
    )
    tape = Tape(
        radius=inputs.number("radius", "m", above=0),
        angle=inputs.number("angle", "rad", above=0),
        law=law,
    )
    turning = Turning(tape, comm, QUICK_CELLS_ACROSS if quick else CELLS_ACROSS)
    energies = np.array([turning.energy(float(φ)) for φ in TURNS])
    is_steady = TURNS >= STEADY_FROM
    moment = float(np.polyfit(2 * TURNS[is_steady], energies[is_steady], 1)[0])
    peak = float((np.diff(energies) / np.diff(2 * TURNS)).max())
    quantities = {"steady moment": Predicted(moment), "peak moment": Predicted(peak)}
    details = {
        "unknowns": float(turning.unknowns),
        "iterations": float(turning.iterations),
        "seconds": turning.seconds,
    }
    return Prediction(quantities, details)
