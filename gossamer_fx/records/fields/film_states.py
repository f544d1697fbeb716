"""States of films: slack, wrinkled and taut, and the areas in each of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.core.forms.compilation import compile_form, constant
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.materials.film import SLACK, TAUT, WRINKLED
from gossamer_fx.records.fields.body_shape import BodyShape
from gossamer_fx.solve.system.system import System

# Numbers of the states by name.
STATES = {"slack": SLACK, "wrinkled": WRINKLED, "taut": TAUT}


def film_state(shape: BodyShape) -> Expr:
    """Return the state of a film as a UFL expression: 0 slack, 1 wrinkled, 2 taut."""
    film = shape.body
    # A law that never wrinkles has a number as its state; times `unit` it belongs to a mesh.
    unit = constant(film.space.mesh, 1.0)
    return unit * film.law.state(shape.elastic_strain(), film.constants)


class AreaFractions:
    """Shares of the reference area of some films that are slack, wrinkled and taut.

    Example:
        >>> from gossamer_fx.records.fields.film_states import AreaFractions
        >>> slack, wrinkled, taut = AreaFractions([film])(run.system)
    """

    def __init__(self, films: Sequence[Membrane]) -> None:
        self._films = films
        # Shape, the state that is asked for, and the form of its area, for each film
        self._compiled: list[tuple[BodyShape, fem.Constant, fem.Form]] | None = None

    def __call__(self, system: System) -> Array:
        """Return the shares (3,) of the area that are slack, wrinkled and taut; their sum is one.

        Collective.  Areas are those of the stress-free shape.
        """
        if self._compiled is None:
            self._compiled = self._compile(system)
        areas = np.zeros(len(STATES))
        for shape, which, form in self._compiled:
            shape.update()
            for state in STATES.values():
                which.value = state
                areas[state] += fem.assemble_scalar(form)
        areas = system.comm.allreduce(areas)
        return areas / areas.sum()

    def _compile(self, system: System) -> list[tuple[BodyShape, fem.Constant, fem.Form]]:
        """Compile the area in one state as a form, for each film; collective.

        Returns:
            for each film its shape, a constant that selects the state (0, 1 or 2), and the form
            [m²] of the area of this rank's cells in that state.
        """
        compiled = []
        for film in self._films:
            shape = BodyShape(system, film)
            # One form with a constant serves the three states.
            which = constant(shape.body.space.mesh, 0.0)
            is_state = ufl.eq(film_state(shape), which)
            area = ufl.conditional(is_state, 1.0, 0.0) * shape.body.dx
            compiled.append((shape, which, compile_form(area)))
        return compiled
