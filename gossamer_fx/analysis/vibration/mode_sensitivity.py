"""Frequencies of modes as results with derivatives.

With K φ = ω² M φ and φ·M φ = 1 at an equilibrium r(q, θ) = 0,

    d(ω²)/dθ = φ·(∂K/∂θ - ω² ∂M/∂θ) φ - λ·∂r/∂θ,    Kᵀ λ = ∂(φ·K φ)/∂q                           (1)

The second term is the share of the equilibrium that moves.  K φ·φ is the second derivative of the
energy forms along φ, from which UFL derives the rest.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
import ufl
from dolfinx import fem, la
from petsc4py import PETSc
from ufl.algorithms import expand_derivatives

from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.analysis.vibration.natural_modes import (
    ZERO_FREQUENCY_FACTOR,
    Mode,
    modes,
    round_off_square,
)
from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.compilation import compile_form, constant
from gossamer_fx.core.model.body import MeshBody, has_nodal_unknowns
from gossamer_fx.mechanics.terms.assembly import Differentiable
from gossamer_fx.records.probes.objective import Objective
from gossamer_fx.solve.system.system import System

# Relative difference of neighbouring frequencies below which a mode is not unique, and its
# frequency has no derivative.
SMALLEST_DISTANCE = 1e-6

# Largest |Kφ - Kᵀφ| over |Kφ|.  Loads that follow the film make K unsymmetric; (1) needs left
# eigenvectors then.
MAX_ASYMMETRY = 1e-8


@check_arguments
class Frequency(Objective):
    """Frequency [Hz] of a mode of an equilibrium, for `gx.analysis.gradient`.

    Args:
        equilibrium: of a scene whose forces are those of films, plates, cables and their loads.
        number: of the mode, from the lowest, which is 0.

    Raises:
        InputError: when derived: the scene has springs or other forces between points, loads make
            the stiffness unsymmetric, the mode has no frequency, or another mode has the same one.

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
        self._forms: list[ufl.Form] | None = None
        self._shapes: dict[MeshBody, fem.Function] = {}
        # 1/(8π² f), by which derivatives of ω² become those of f, and ω²: constants of the forms.
        self._factors: dict[MeshBody, tuple[fem.Constant, fem.Constant]] = {}
        self._by_position: dict[MeshBody, list[fem.Form]] = {}

    def __call__(self, run: Any) -> float:
        """The frequency in the equilibrium of this object, whatever `run` is."""
        return self._mode().frequency

    def _mode(self) -> Mode:
        """The mode, which is to be the only one of its frequency.  Collective."""
        check(
            not self._equilibrium.system.equations.scalar_unknowns,
            "Frequency: the scene has gas chambers, by whose state it is not derived; "
            "give their pressure as Pressure.",
        )
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

    def forms(self, system: System) -> list[ufl.Form]:
        """φ·(K - ω² M) φ/(8π² f) of the mode φ that `add_derivative` found last, whose derivatives
        at a given φ are those of f; made at the first call."""
        if self._forms is not None:
            return self._forms
        _check_made_of_forms(system)
        self._forms = []
        for body in system.unknowns.bodies:
            if not (isinstance(body, MeshBody) and has_nodal_unknowns(body)):
                continue
            q = system.unknowns.coordinates[body].q1
            mesh = body.space.mesh
            φ = fem.Function(body.space)
            factor = constant(mesh, 0.0)
            ω2 = constant(mesh, 0.0)
            self._shapes[body] = φ
            self._factors[body] = (factor, ω2)
            own = []
            for compiled in system.equations.differentiable:
                for form in compiled.residual_forms(body, φ):
                    # The derivative of a load that does not follow the body is empty.
                    stiffness = expand_derivatives(ufl.derivative(form, q, φ))
                    if not stiffness.empty():
                        own.append(factor * stiffness)
            w = ufl.TestFunction(body.space)
            self._by_position[body] = [compile_form(ufl.derivative(one, q, w)) for one in own]
            for compiled in system.equations.differentiable:
                own += [-factor * ω2 * form for form in compiled.kinetic_forms(body, φ, φ)]
            self._forms += own
        return self._forms

    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Find the mode, and add ∂f/∂q [Hz/m] at a given φ; velocities change no frequency.  Mode
        and frequency are then constants of `forms`."""
        self.forms(system)
        mode = self._mode()
        shape = system.unknowns.numbering.vector()
        shape.array[:] = np.real(mode.shape)
        shape.array[system.unknowns.supports.held] = 0
        _check_symmetric(system, shape)
        product = shape.duplicate()
        system.unknowns.M.mult(shape, product)
        shape.scale(1 / math.sqrt(product.dot(shape)))
        ω = 2 * math.pi * mode.frequency
        for body, φ in self._shapes.items():
            at = system.unknowns.coordinates[body]
            owned = system.unknowns.block(body).owned
            at.take(φ, shape.array_r[owned])
            factor, ω2 = self._factors[body]
            # f = ω/(2π), and ∂(ω²) = φ·∂K φ: ∂f = φ·∂K φ/(8π² f).
            factor.value = 1 / (8 * math.pi**2 * mode.frequency)
            ω2.value = ω**2
            dofs = body.space.dofmap
            b = la.vector(dofs.index_map, dofs.index_map_bs)
            b.array[:] = 0
            for form in self._by_position[body]:
                fem.assemble_vector(b.array, form)
            b.scatter_reverse(la.InsertMode.add)
            with by_position as values:
                at.add_forces(b.array, values[owned])


def _check_made_of_forms(system: System) -> None:
    """Raise `InputError` if forces act on or between points."""
    for compiled in system.equations.compiled:
        check(
            isinstance(compiled, Differentiable) and compiled.forces_are_forms,
            f"Frequency: the scene has {type(compiled).__name__}, "
            "whose second derivatives are not known; leave out what acts on points.",
        )


def _check_symmetric(system: System, shape: PETSc.Vec) -> None:
    """Raise `InputError` if |K φ - Kᵀ φ| is more than round-off of |K φ| for a mode φ.  Sets the
    inertia of the system to zero.  Collective."""
    system.equations.set_inertia(0.0)
    K = system.matrices.tangent()
    force = shape.duplicate()
    transposed = shape.duplicate()
    K.mult(shape, force)
    K.multTranspose(shape, transposed)
    transposed.axpy(-1.0, force)
    check(
        transposed.norm() <= MAX_ASYMMETRY * force.norm(),
        "Frequency: loads make the stiffness unsymmetric, "
        "so that its frequencies have no derivative here; hold the rim of what is under pressure.",
    )
