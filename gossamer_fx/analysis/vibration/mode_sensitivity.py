"""Frequencies of modes as results with derivatives.

With K φ = ω² M φ and φ·M φ = 1 at an equilibrium r(q, θ) = 0,

    d(ω²)/dθ = φ·(∂K/∂θ - ω² ∂M/∂θ) φ - λ·∂r/∂θ,    Kᵀ λ = ∂(φ·K φ)/∂q                           (1)

The second term is the share of the equilibrium that moves; `sensitivity.along_shape` has the
derivatives of φ·K φ.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from petsc4py import PETSc

from gossamer_fx.analysis.sensitivity.along_shape import StiffnessAlong
from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.analysis.vibration.natural_modes import (
    ZERO_FREQUENCY_FACTOR,
    Mode,
    modes,
    round_off_square,
)
from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.lookups import check_no_gas
from gossamer_fx.records.probes.objective import Objective
from gossamer_fx.solve.system.system import System

# Relative difference of neighbouring frequencies below which a mode is not unique, and its
# frequency has no derivative.
SMALLEST_DISTANCE = 1e-6


@check_arguments
class Frequency(Objective):
    """Frequency [Hz] of a mode of an equilibrium, for `gx.analysis.gradient`.

    Args:
        equilibrium: of a scene without contact and gas.
        number: of the mode, from the lowest, which is 0.

    Raises:
        InputError: when derived: the scene has contact or gas, loads make the stiffness
            unsymmetric, the mode has no frequency, or another mode has the same one.

    Example:
        >>> edges = [gx.Fixed(film, edge) for edge in ("bottom", "right", "top", "left")]
        >>> equilibrium = gx.Equilibrium(gx.Scene(film, *edges))
        >>> gx.analysis.Frequency(equilibrium, number=1).number
        1
    """

    unit = "Hz"

    def __init__(self, equilibrium: Equilibrium, *, number: Annotated[int, Range(0)] = 0) -> None:
        self.number = number
        self._equilibrium = equilibrium
        # Of the mode that was derived last: φ, and c and ω² with ∂f = c φ·(∂K - ω² ∂M) φ.
        self._shape: PETSc.Vec | None = None
        self._factor = 0.0
        self._square = 0.0

    def __call__(self, run: Any) -> float:
        """The frequency in the equilibrium of this object, whatever `run` is."""
        return self._mode().frequency

    def _mode(self) -> Mode:
        """The mode, which is to be the only one of its frequency.  Collective."""
        system = self._equilibrium.system
        check_no_gas(system, "Frequency", "by whose state it is not derived")
        found = modes(self._equilibrium, self.number + 2)
        mode = found[self.number]
        equilibrium = self._equilibrium
        zero = 0.0
        if not equilibrium.is_known_regular:
            system = equilibrium.system
            system.equations.set_inertia(0.0)
            square = round_off_square(system.matrices.tangent(), system.unknowns.M)
            zero = math.sqrt(ZERO_FREQUENCY_FACTOR * square) / (2 * math.pi)
        check(
            mode.frequency > zero,
            f"Frequency: mode {self.number} has {mode.frequency:.2g} Hz, which is zero within "
            "round-off, as it is a rigid motion, of slack film or not stable; "
            "choose another mode.",
        )
        for k in (self.number - 1, self.number + 1):
            if k >= 0:
                distance = abs(found[k].frequency - mode.frequency) / mode.frequency
                check(
                    distance > SMALLEST_DISTANCE,
                    f"Frequency: modes {self.number} and {k} have the same frequency, "
                    f"{mode.frequency:.6g} Hz, which has no derivative; "
                    "choose another mode, or break the symmetry.",
                )
        return mode

    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Find the mode, and add ∂f/∂q [Hz/m] at a given φ; velocities change no frequency.  The
        other derivatives are then those of this mode."""
        mode = self._mode()
        shape = system.unknowns.numbering.vector()
        shape.array[:] = np.real(mode.shape)
        shape.array[system.unknowns.supports.held] = 0
        product = shape.duplicate()
        system.unknowns.M.mult(shape, product)
        shape.scale(1 / math.sqrt(product.dot(shape)))
        self._shape = shape
        # f = ω/(2π), and ∂(ω²) = φ·∂K φ: ∂f = φ·∂K φ/(8π² f).
        self._factor = 1 / (8 * math.pi**2 * mode.frequency)
        self._square = (2 * math.pi * mode.frequency) ** 2
        system.equations.set_inertia(0.0)
        self._stiffness(system).add_by_position(by_position)

    def _stiffness(self, system: System) -> StiffnessAlong:
        assert self._shape is not None, "the mode is derived first"
        return StiffnessAlong(system, self._shape, self._factor, "Frequency")

    def residual_parts(self, system: System) -> list[tuple[PETSc.Vec, PETSc.Vec]]:
        return self._stiffness(system).residual_parts()

    def mass_parts(self, system: System) -> list[tuple[PETSc.Vec, PETSc.Vec]]:
        assert self._shape is not None, "the mode is derived first"
        weights = self._shape.copy()
        weights.scale(-self._factor * self._square)
        return [(self._shape, weights)]
