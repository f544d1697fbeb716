"""Forces on all mass: uniform gravity, and the centrifugal force under which a steady spin is an
equilibrium."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check, is_vector
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import Array, Body, Vector
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Parameter, Term, terms_of
from gossamer_fx.mechanics.loads.attached_loads import AttachedLoad
from gossamer_fx.mechanics.terms.loads import Load
from gossamer_fx.mechanics.terms.masses import KineticEnergy


@check_arguments
@dataclass(frozen=True, eq=False)
class Gravity:
    """The weight of a body: its mass matrix times an acceleration, e.g. δW = ∫ρt g·w dA of a film.

    What is bonded to the body, e.g. a `Tape` or an `AttachedMass`, is accelerated with it.

    Args:
        body: any body.
        g: acceleration [m/s²].
        name: name in messages and output.

    Example:
        >>> gx.Gravity(film, (0.0, 0.0, -1.62)).name
        'gravity of film'
    """

    body: Body
    g: tuple[float, float, float] = (0.0, 0.0, -9.80665)
    _: KW_ONLY
    name: str = ""

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", f"gravity of {self.body.name}")
        check(
            is_vector(self.g),
            f"Gravity '{self.name}': g is {self.g!r} m/s²; give three finite numbers.",
        )

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        for part in terms_of(self.body, start):
            if isinstance(part, KineticEnergy):
                yield self._on_mesh(part)
        # Masses that other items attach are not among the terms of the body; the system knows them.
        # Acceleration of gravity (3,) [m/s²]
        g = np.asarray(self.g, dtype=float)
        yield AttachedLoad(self.name, self.body, g, np.zeros((3, 3)), np.zeros(3))

    def _on_mesh(self, part: KineticEnergy) -> Term:
        """Return the weight of a mass of a mesh: the body's mass form applied to g [m/s²]."""
        size = part.body.block.size
        # Directors of a beam are directions: a uniform acceleration does not turn them.
        on_directors = (0.0,) * (size - 3)
        # g (3,) [m/s²] is the acceleration of gravity; w below are test functions.
        g = tuple(float(c) for c in self.g)
        # A constant, so that another g needs no new kernel.
        acceleration = fem.Constant(part.body.space.mesh, g + on_directors)

        def work(q: Expr, w: Expr) -> ufl.Form:
            return part.mass(acceleration, w)

        # The acceleration of a beam has entries for its directors, too; those are not parameters.
        parameters: tuple[Parameter, ...] = ()
        if size == 3:
            parameters = (Parameter("g", "m/s²", acceleration),)
        return Load(self.name, part.body, work, parameters=parameters)


@check_arguments
@dataclass(frozen=True, eq=False)
class Centrifugal:
    """Centrifugal force of a body in axes that turn with a constant angular velocity Ω about a
    point c.

        δW = M-weighted (|Ω|² 1 - Ω Ωᵀ)(q - c)·w   over positions and directors

    With it an equilibrium is the steady spin as seen from these axes: find it, then start with
    `StartFrom` and `RigidMotion` of the same spin; `analysis.modes` about it add the Coriolis
    force.

    Args:
        body: any body.
        spin: Ω [rad/s], not zero.
        centre: c [m].
        name: name in messages and output.

    Raises:
        InputError: a spin of zero.

    Example:
        >>> gx.loads.Centrifugal(film, (0.0, 0.0, 10.0), centre=(0.5, 0.5, 0.0)).name
        'centrifugal force on film'
    """

    body: Body
    spin: Vector
    _: KW_ONLY
    centre: Vector = (0.0, 0.0, 0.0)
    name: str = ""

    def __post_init__(self) -> None:
        check(
            any(self.spin),
            f"Centrifugal force on '{self.body.name}': spin is zero; give Ω in rad/s.",
        )
        if not self.name:
            object.__setattr__(self, "name", f"centrifugal force on {self.body.name}")

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        Ω = np.asarray(self.spin, dtype=float)
        c = np.asarray(self.centre, dtype=float)
        # -Ω × (Ω × r) = (|Ω|² 1 - Ω Ωᵀ) r
        A = Ω @ Ω * np.eye(3) - np.outer(Ω, Ω)
        for part in terms_of(self.body, start):
            if isinstance(part, KineticEnergy):
                yield self._on_mesh(part, A, c)
        yield AttachedLoad(self.name, self.body, np.zeros(3), A, c)

    def _on_mesh(self, part: KineticEnergy, A: Array, c: Array) -> Term:
        """The load on a mass of a mesh: the body's mass form applied to the acceleration A (x - c),
        A (3, 3) [1/s²]."""
        mesh = part.body.space.mesh
        size = part.body.block.size
        # Constants, so that another spin needs no new kernel.  Directors have no centre.
        rotation = fem.Constant(mesh, A)
        centre = fem.Constant(mesh, np.concatenate([c, np.zeros(size - 3)]))

        # q are coordinates of the body, w test functions and r = q - centre.
        def work(q: Expr, w: Expr) -> ufl.Form:
            """Virtual work [J] at coordinates q along test functions w."""
            r = q - centre
            components = []
            for first in range(0, size, 3):
                vector = ufl.as_vector([r[first + i] for i in range(3)])
                acceleration = ufl.dot(rotation, vector)
                components += [acceleration[i] for i in range(3)]
            return part.mass(ufl.as_vector(components), w)

        return Load(self.name, part.body, work, follows=True)
