"""Damping of films, off unless it is part of the scene; what it takes is booked as dissipated."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import ufl

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.errors import check
from gossamer_fx.forms.compilation import constant
from gossamer_fx.materials.film import Linear
from gossamer_fx.model.terms import Term
from gossamer_fx.terms.element_energies import Dissipation


@dataclass(frozen=True, eq=False)
class Damping:
    """Mass- and stiffness-proportional damping of a film.

    mass [1/s]: force -mass ρt v per area; it slows every motion, rigid ones too.
    stiffness [s]: stress `stiffness`·C Ė with the unwrinkled elastic matrix C (Kelvin-Voigt); rigid motions are free.
    A mode of angular frequency ω loses the fraction ζ = mass/(2ω) + stiffness ω/2 of critical damping.
    """

    body: Membrane
    mass: float = 0.0
    stiffness: float = 0.0
    name: str = "damping"

    def __post_init__(self) -> None:
        check(
            self.mass >= 0 and self.stiffness >= 0 and self.mass + self.stiffness > 0,
            f"Damping '{self.name}': mass {self.mass!r} 1/s and stiffness {self.stiffness!r} s; one must be positive, "
            "none negative.",
        )

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self) -> Iterable[Term]:
        film, law = self.body, self.body.law
        if self.mass > 0:
            α = constant(film.space.mesh, self.mass)
            yield Dissipation(
                self.name + " (mass)",
                film,
                lambda x: x,
                lambda v: α * film.area_density / 2 * ufl.dot(v, v),
                film.mass_dx,
            )
        if self.stiffness > 0:
            β = constant(film.space.mesh, self.stiffness)
            unwrinkled = Linear(law.E, law.nu, law.density, law.thickness)
            yield Dissipation(
                self.name + " (stiffness)",
                film,
                film.measure,
                lambda ė: β * unwrinkled.energy(ė, film.constants),
                film.dx,
            )
