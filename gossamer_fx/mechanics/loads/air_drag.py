"""Residual air that slows films: its drag dissipates, and the work of a wind is supplied."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.core.checks.arguments import check_arguments, positive
from gossamer_fx.core.forms.compilation import compile_form, constant
from gossamer_fx.core.forms.kinematics import Expr, area_vector
from gossamer_fx.core.model.body import Array, MeshBody, Vector
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.terms.assembly import Assembly, Compiler
from gossamer_fx.mechanics.terms.loads import Loads, at_rate, rate_of

# (da/dA)² below which a cell has collapsed: nothing acts on it, and nothing is divided by zero.
MIN_SQUARED_AREA_RATIO = 1e-30


@check_arguments
@dataclass(frozen=True, eq=False)
class AirDrag:
    """Drag of thin air on a film or plate: a pressure along the deformed normal n against the
    normal velocity.

        δW = -½ ρ C ∫|vₙ| vₙ n·w da,    vₙ = n·(v - u),    da the deformed area

    v is the velocity of the film at the middle of the step, (x1 - x0)/h, so that the loss ½ ρ C
    ∫|vₙ|³ da closes the balance of energy exactly; the work of the wind u counts as supplied.  |vₙ|
    vₙ has a continuous derivative, at zero, too.  Each piece of film is slowed as if it were alone
    in the flow.  Left out are the friction along it, its wake, the shelter behind other pieces, and
    the air that it carries along, whose mass per area is about ρ times the width of the film.  In
    an `Equilibrium` still air has no part, and wind presses with ½ ρ C uₙ². (`Drag` is the
    free-molecular flow of an orbit.)

    Args:
        body: the film.
        density: ρ [kg/m³]; of air with the pressure p and the temperature T it is p/(287 T).
        drag_coefficient: C of a piece across the flow, for both faces; 1.2 is about that of a
            square or round plate at Reynolds numbers from 1000 on (S. F. Hoerner, Fluid-Dynamic
            Drag, 1965, chapter 3).  Where the mean free path, 7 mm at 1 Pa, is not short compared
            with the film, air takes more, in proportion to vₙ.
        wind: velocity u of the air [m/s].

    Exact solution: a flat film of areal mass σ that is thrown along its normal has 1/v = 1/v0 + ρ C
    t/(2 σ); one that falls comes to v = √(2 σ g/(ρ C)).

    Example:
        >>> gx.loads.AirDrag(film, 1.2, wind=(0.0, 0.0, 3.0)).drag_coefficient
        1.2
    """

    USUAL: ClassVar = {"density": (1e-12, 10.0, "kg/m³")}  # of gases

    body: Membrane
    density: Annotated[float, positive("kg/m³")]
    _: KW_ONLY
    drag_coefficient: Annotated[float, positive()] = 1.2
    wind: Vector = (0.0, 0.0, 0.0)
    name: str = "air drag"

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        film = self.body
        mesh = film.space.mesh
        half_ρC = constant(mesh, self.density * self.drag_coefficient / 2)
        # Still air has no term for the work of a wind, which would cost an integral a step.
        # u is the velocity of the wind (3,) [m/s], v that of the film, ρ the density and C the drag
        # coefficient.
        u = None
        if any(self.wind):
            u = fem.Constant(mesh, tuple(map(float, self.wind)))
        # Exact for a flat film and velocities of one sign; where the sign changes no degree is
        # exact.
        dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 3 * film.order})

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

    With the velocity v = (q1 - q0)/h of a step h δW[v] is the work of the force on the way from q0
    to q1.  In a wind u it is the sum of h δW[v - u], which is lost, and h δW[u], which is supplied.
    """

    def __init__(self, terms: Sequence[FilmDrag], system: Assembly) -> None:
        coordinates = [system.coordinates[term.body] for term in terms]
        loads = []
        for term, at in zip(terms, coordinates, strict=True):
            loads.append(at_rate(term, at))
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
        return float(sum(fem.assemble_scalar(form) for form in self._given))

    def dissipated(self) -> Array:
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
