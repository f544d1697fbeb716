"""Probes of cables, beams, connectors and creases: tension, strain, length and angle."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import InputError
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.state import HasSystem
from gossamer_fx.mechanics.bodies.cable import Curve
from gossamer_fx.mechanics.bodies.frames import DrawnAsLines
from gossamer_fx.mechanics.connectors.crease import Crease
from gossamer_fx.mechanics.connectors.crease_energies import CreaseEnergies
from gossamer_fx.records.fields.axial_force import CurrentLength, GaussValues, axial_strain, tension
from gossamer_fx.records.fields.body_shape import AlternationWatch, At, BodyShape
from gossamer_fx.records.fields.lines import LineForces, line_forces
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.view import ForSystem, StateView

# What is reported of the values along a line
Which = Literal["mean", "least", "largest"]


class _AlongLine:
    """A quantity along a line: its mean, its least or its largest value.

    Args:
        of_body: the quantity as an expression, where the line is a cable or beam.
        of_connector: the quantity (n,) of the n lines of a connector.
    """

    def __init__(
        self,
        line: Curve | DrawnAsLines,
        which: Which,
        at: At,
        *,
        of_body: Callable[[BodyShape], Expr],
        of_connector: Callable[[LineForces], Array],
    ) -> None:
        self.line = line
        self.which = which
        self.at: At = at
        self._of_connector = of_connector
        self._alternation = AlternationWatch(line, "of it is")
        if isinstance(line, Curve):
            self._values = ForSystem(lambda system: GaussValues(system, line, of_body, at))

    def __call__(self, run: HasSystem) -> float:
        """The value in a state.  Collective, the same on every rank."""
        if isinstance(self.line, Curve):
            return self._along_body(run.system)
        lines = line_forces(run.system, self.line, self.at)
        self._alternation.see(run.system, lines.alternating)
        values = self._of_connector(lines)
        if self.which == "least":
            return float(values.min())
        if self.which == "largest":
            return float(values.max())
        return float(values @ lines.weights)

    def _along_body(self, system: System) -> float:
        """The value of a cable or beam."""
        values = self._values(system)
        values.update()
        if self.which == "mean":
            return values.mean()
        least, largest = values.extremes()
        if self.which == "least":
            return least
        return largest


@check_arguments
class Tension(_AlongLine):
    """Tension [N] of a cable, beam, tape, spring, rope or tether, negative for compression.

    Of a beam it is the axial force.  The force of a damping is not included.  The mean is that
    along the natural length; of a bundle that of its ropes.

    Args:
        line: a `Cable`, `Beam`, `Tape`, `Spring`, `Rope`, `RopeBundle` or `Tether` of the scene.
        which: "mean", "least" or "largest" along the line, or of the ropes of a bundle.
        at: "mean" over the last step, or "end" for that at its end, e.g. for an event, which
            divides steps.

    Raises:
        InputError: `which` is unknown, or the line is something else; when called, the line is not
            in the scene.

    Example:
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=0.9)
        >>> tension = gx.probes.Tension(spring)
        >>> run = gx.Simulation(gx.Scene(spring), gx.Midpoint(dt=0.1))
        >>> round(tension(run), 9)
        10.0
    """

    unit = "N"

    def __init__(
        self, line: Curve | DrawnAsLines, which: Which = "mean", *, at: At = "mean"
    ) -> None:
        super().__init__(
            line, which, at, of_body=tension, of_connector=lambda lines: lines.tensions
        )


@check_arguments
class AxialStrain(_AlongLine):
    """Strain of a cable, beam, tape, spring, rope or tether, of which its tension is a function.

    It is the change of length over the natural length.  Of a cable or beam it contains the initial
    strain, and not the thermal strain.

    Args:
        line: a `Cable`, `Beam`, `Tape`, `Spring`, `Rope`, `RopeBundle` or `Tether` of the scene.
        which: "mean", "least" or "largest" along the line, or of the ropes of a bundle.

    Raises:
        InputError: `which` is unknown, or the line is something else; when called, the line is not
            in the scene.

    Example:
        >>> cable = gx.Cable(curve, gx.CableLaw(1e4, 0.01), initial_tension=50.0)
        >>> statics = gx.Equilibrium(gx.Scene(cable, gx.Fixed(cable, "line")))
        >>> round(gx.probes.AxialStrain(cable)(statics), 6)
        0.004988
    """

    unit = ""

    def __init__(self, line: Curve | DrawnAsLines, which: Which = "mean") -> None:
        super().__init__(
            line, which, "end", of_body=axial_strain, of_connector=lambda lines: lines.strains
        )


@check_arguments
class Length:
    """Length [m] of a cable, beam, tape, spring, rope or tether in its present shape.

    That of a bundle is the sum of the lengths of its ropes.

    Args:
        line: a `Cable`, `Beam`, `Tape`, `Spring`, `Rope`, `RopeBundle` or `Tether` of the scene.

    Raises:
        InputError: the line is something else; when called, the line is not in the scene.

    Example:
        >>> cable = gx.Cable(curve, gx.CableLaw(1e4, 0.01))
        >>> run = gx.Simulation(gx.Scene(cable), gx.Midpoint(dt=0.1))
        >>> round(gx.probes.Length(cable)(run), 9)
        1.0
    """

    unit = "m"

    def __init__(self, line: Curve | DrawnAsLines) -> None:
        self.line = line
        if isinstance(line, Curve):
            self._length = ForSystem(lambda system: CurrentLength(system, line))

    def __call__(self, run: HasSystem) -> float:
        """The length [m] in the state of a run or an equilibrium.  Collective.

        Args:
            run: a `Simulation` or an `Equilibrium`.

        Raises:
            InputError: the line is not in the scene.
        """
        system = run.system
        if not isinstance(self.line, Curve):
            return float(line_forces(system, self.line, "end").lengths.sum())
        return self._length(system)()


@check_arguments
class FoldAngle:
    """Angle [rad] of a crease: positive for a valley fold, zero where it is flat.

    Args:
        crease: a crease of the scene.
        which: "mean", "least" or "largest" along the crease, or "rest" for the mean of its rest
            angle, which changes if the crease yields.  Means are weighted with the stiffness of the
            crease along it.

    Raises:
        InputError: `which` is unknown; when called, the crease is not in the scene.

    Example:
        >>> crease = gx.connectors.Crease(creased, "crease", stiffness=0.01)
        >>> angle = gx.probes.FoldAngle(crease, "mean")
    """

    def __init__(self, crease: Crease, which: Which | Literal["rest"] = "mean") -> None:
        self.crease = crease
        self.which = which

    def __call__(self, run: StateView) -> float:
        """The angle [rad] in the state of a run."""
        return self.of(run.system)

    def of(self, system: System) -> float:
        """The angle [rad] in the state of a system, e.g. that of an `Equilibrium`.  Collective.

        Args:
            system: a compiled scene with the crease.

        Raises:
            InputError: the crease is not in the scene.
        """
        energy = self.crease.energy
        angles, rest_angles = self._compiled(system).angles(energy)
        # A rank may have no point of the crease: infinities are neutral then.
        if self.which == "least":
            least = float(angles.min(initial=np.inf))
            return float(system.comm.allreduce(least, op=MPI.MIN))
        if self.which == "largest":
            largest = float(angles.max(initial=-np.inf))
            return float(system.comm.allreduce(largest, op=MPI.MAX))
        if self.which == "rest":
            return _mean(system, energy.stiffness, rest_angles)
        return _mean(system, energy.stiffness, angles)

    def _compiled(self, system: System) -> CreaseEnergies:
        """The compiled creases of a scene with this one; `InputError` if it is not among them."""
        energy = self.crease.energy
        for creases in system.equations.compiled_as(CreaseEnergies):
            if creases.has(energy):
                return creases
        raise InputError(f"'{self.crease.name}' is not in the scene; add it, or remove its probe.")


def _mean(system: System, weights: Array, values: Array) -> float:
    """Weighted mean over the points of all ranks."""
    own_sums = np.array([float(weights @ values), float(weights.sum())])
    total, weight = system.comm.allreduce(own_sums)
    return float(total / weight)
