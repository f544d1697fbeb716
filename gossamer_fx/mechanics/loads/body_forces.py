"""Loads in the interior of bodies: on all of their mass, uniform gravity and the centrifugal force
under which a steady spin is an equilibrium; on films, the drag of residual air, which dissipates,
and in a wind supplies work.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, ClassVar

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.core.checks.arguments import Direction, check_arguments, positive
from gossamer_fx.core.forms.compilation import compile_form, constant
from gossamer_fx.core.forms.kinematics import Expr, area_vector
from gossamer_fx.core.model.body import Array, Body, MeshBody, Vector
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import OnBody, Parameter, Term
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.loads.attached_loads import ACCELERATION, AttachedLoad
from gossamer_fx.mechanics.terms.assembly import Assembly, Compiler
from gossamer_fx.mechanics.terms.loads import Load, Loads, at_rate, rate_of
from gossamer_fx.mechanics.terms.masses import KineticEnergy


@check_arguments
@dataclass(frozen=True, eq=False)
class Gravity(OnBody):
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

    def terms(self, start: State) -> Iterable[Term]:
        for part in self.body.terms(start):
            if isinstance(part, KineticEnergy):
                yield self._on_mesh(part)
        # Masses that other items attach are not among the terms of the body; the system knows them.
        # Acceleration of gravity (3,) [m/s²]
        yield AttachedLoad(
            self.name,
            self.body,
            acceleration=np.asarray(self.g, dtype=float),
            gradient=np.zeros((3, 3)),
            centre=np.zeros(3),
            parameters=(Parameter("g", "m/s²", ACCELERATION),),
        )

    def _on_mesh(self, part: KineticEnergy) -> Term:
        """Return the weight of a mass of a mesh: the body's mass form applied to g [m/s²]."""
        # Acceleration of gravity (3,) [m/s²]: a constant, so that another one needs no new kernel.
        g = fem.Constant(part.body.space.mesh, tuple(float(c) for c in self.g))
        # Directors of a beam are directions: a uniform acceleration does not turn them.  UFL wants
        # components of one kind: a plain 0 would be of another.
        on_directors = [0 * g[0]] * (part.body.block.size - 3)
        acceleration = ufl.as_vector([g[0], g[1], g[2], *on_directors])

        def work(q: Expr, w: Expr) -> ufl.Form:
            return part.mass(acceleration, w)

        return Load(self.name, part.body, work, parameters=(Parameter("g", "m/s²", g),))


@check_arguments
@dataclass(frozen=True, eq=False)
class Centrifugal(OnBody):
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
    spin: Direction
    _: KW_ONLY
    centre: Vector = (0.0, 0.0, 0.0)
    name: str = ""

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", f"centrifugal force on {self.body.name}")

    def terms(self, start: State) -> Iterable[Term]:
        Ω = np.asarray(self.spin, dtype=float)
        c = np.asarray(self.centre, dtype=float)
        # -Ω × (Ω × r) = (|Ω|² 1 - Ω Ωᵀ) r
        A = Ω @ Ω * np.eye(3) - np.outer(Ω, Ω)
        for part in self.body.terms(start):
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


# (da/dA)² below which a cell has collapsed: nothing acts on it, and nothing is divided by zero.
MIN_SQUARED_AREA_RATIO = 1e-30


@check_arguments
@dataclass(frozen=True, eq=False)
class AirDrag(OnBody):
    """Drag of thin air on a film or plate: a pressure along the deformed normal n against the
    normal velocity.

        δW = -½ ρ C ∫|vₙ| vₙ n·w da,    vₙ = n·(v - u),    da the deformed area

    v is the velocity of the film at the middle of the step, (x1 - x0)/h, so that the loss ½ ρ C
    ∫|vₙ|³ da closes the balance of energy exactly; the work of the wind u counts as supplied.  |vₙ|
    vₙ has a continuous derivative, at zero, too.  Each piece of film is slowed as if it were alone
    in the flow.  Left out are the friction along it, its wake, the shelter behind other pieces, and
    the air that it carries along, whose mass per area is about ρ times the width of the film.  In
    an `Equilibrium` still air has no part, and wind presses with ½ ρ C uₙ²; its work does not count
    there, as it depends on the pseudo-steps. (`Drag` is the free-molecular flow of an orbit.)

    Args:
        body: the film.
        density: ρ [kg/m³]; of air with the pressure p and the temperature T it is p/(287 T).
        drag_coefficient: C of a piece across the flow, for both faces; 1.2 is about that of a
            square or round plate at Reynolds numbers from 1000 on (S. F. Hoerner, Fluid-Dynamic
            Drag, 1965, chapter 3).  Where the mean free path, 7 mm at 1 Pa, is not short compared
            with the film, air takes more, in proportion to vₙ.
        wind: velocity u of the air [m/s].
        name: name in messages and output.

    Exact solution: a flat film of areal mass σ that is thrown along its normal has 1/v = 1/v0 + ρ C
    t/(2 σ); one that falls comes to v = √(2 σ g/(ρ C)).

    Example:
        >>> gx.loads.AirDrag(film, 1.2, wind=(0.0, 0.0, 3.0)).drag_coefficient
        1.2
    """

    USUAL: ClassVar = {"density": (1e-12, 10.0, "kg/m³", "")}  # of gases

    body: Membrane
    density: Annotated[float, positive("kg/m³")]
    _: KW_ONLY
    drag_coefficient: Annotated[float, positive()] = 1.2
    wind: Vector = (0.0, 0.0, 0.0)
    name: str = "air drag"

    def terms(self, start: State) -> Iterable[Term]:
        film = self.body
        mesh = film.space.mesh
        half_ρC = constant(mesh, self.density * self.drag_coefficient / 2)
        # Velocity of the wind (3,) [m/s].  Still air has none: the work of a wind would cost an
        # integral a step.
        u = None
        if any(self.wind):
            u = fem.Constant(mesh, tuple(map(float, self.wind)))
        # Exact for a flat film and velocities of one sign; where the sign changes no degree is
        # exact.
        dx = film.surface_measure(3 * film.order)

        def work(x: Expr, v: Expr, w: Expr) -> ufl.Form:
            """Virtual work [J] at positions x and velocities v [m/s] along test functions w."""
            a = area_vector(film.deformation(x))  # n da/dA
            relative = v if u is None else v - u
            va = ufl.dot(relative, a)  # vₙ da/dA
            # |vₙ| vₙ n·w da = |va| va (a·w)/|a|² dA: no root, whose derivative is infinite at zero.
            squared_ratio = ufl.max_value(ufl.dot(a, a), MIN_SQUARED_AREA_RATIO)
            return -half_ρC * abs(va) * va * ufl.dot(a, w) / squared_ratio * dx

        yield FilmDrag(self.name, film, work, u)


class Drags(Loads):
    """All `FilmDrag` terms of a scene.

    δW[w] is the virtual work [W] of the force along a velocity w.  With v = (q1 - q0)/h, h δW[v] is
    the work [J] of a step of length h, the sum of h δW[v - u], which is lost, and h δW[u], which
    the wind u supplies.
    """

    def __init__(self, terms: Sequence[FilmDrag], system: Assembly) -> None:
        coordinates = [system.coordinates[term.body] for term in terms]
        loads = []
        for term, at in zip(terms, coordinates, strict=True):
            loads.append(at_rate(term.name, term.body, term.work, at))
        super().__init__(loads, system)
        self.losses = [term.name for term in terms]
        # The step is a constant of the forms: another one needs no new kernel.
        self._steps = [at.h for at in coordinates]
        self._lost: list[fem.Form] = []
        self._given: list[fem.Form] = []
        for term, at in zip(terms, coordinates, strict=True):
            # Mean velocity [m/s] of the step
            v = rate_of(at)
            relative = v
            if term.wind is not None:
                relative = v - term.wind
                # What the wind does at its own velocity is supplied; the rest is lost.  The two add
                # up to the work of the force, so that the balance of energy closes exactly.
                supplied = at.h * term.work(at.mid, v, term.wind)
                self._given.append(compile_form(supplied))
            lost = -at.h * term.work(at.mid, v, relative)
            self._lost.append(compile_form(lost))

    def begin_step(self, t: float) -> None:
        # Before the loads are assembled: their velocity is a difference over this step.
        for h in self._steps:
            h.value = self._system.h
        super().begin_step(t)

    def supplied(self) -> float:
        """Work [J] of the wind in the step, this rank's share: none in a search for rest, whose
        velocities are those of its pseudo-time.  The wind has no potential that could be counted
        instead."""
        if self._system.rule.is_static:
            return 0.0
        return float(sum(fem.assemble_scalar(form) for form in self._given))

    def dissipated(self) -> Array:
        """Loss [J] of each drag in the step, this rank's share: none in a search for rest."""
        if self._system.rule.is_static:
            return np.zeros(len(self._lost))
        return np.array([fem.assemble_scalar(form) for form in self._lost])


@dataclass(frozen=True, eq=False)
class FilmDrag:
    """A force against the velocity v - u in a medium that moves with the wind u.

    work    δW(x, v, w) at the positions x, linear in w; δW(x, v, v - u) is never positive
    wind    u [m/s]; none: the medium is at rest
    """

    name: str
    body: MeshBody
    work: Callable[[Expr, Expr, Expr], ufl.Form]
    wind: Expr | None = None
    compiler: ClassVar[Compiler] = Drags
