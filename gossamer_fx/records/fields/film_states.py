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
from gossamer_fx.records.fields.best_surface import cells_of
from gossamer_fx.records.fields.body_shape import PATH_POINTS, AlternationWatch, At, BodyShape
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.view import ForSystem

# Numbers of the states by name.
STATES = {"slack": SLACK, "wrinkled": WRINKLED, "taut": TAUT}


def film_state(shape: BodyShape) -> Expr:
    """Return the state of a film as a UFL expression: 0 slack, 1 wrinkled, 2 taut, or the mean of
    the states that the path of the last step passes."""
    _, wrinkled, taut = state_shares(shape)
    return WRINKLED * wrinkled + TAUT * taut


def state_shares(shape: BodyShape) -> tuple[Expr, ...]:
    """Return the shares of the path of the last step that are slack, wrinkled and taut, as UFL
    expressions whose sum is one."""
    e0, e1 = shape.strain_path()
    film = shape.body
    # A path of one strain has one state; so has a quadratic law, which never wrinkles.
    if e0 is e1 or film.law.quadratic:
        return _is_state(film, e1)
    # Pieces of the path from 0 to 1 with one state each; none where the law does not know them.
    pieces = film.pieces(e0, e1)
    if pieces:
        length = [ufl.as_ufl(0.0)] * len(STATES)
        for piece in pieces:
            length[piece.state] += piece.end - piece.start
        # Strains of the size of round-off are taut, and may be in the cone of slack ones, too.
        slack = ufl.min_value(length[SLACK], 1 - length[TAUT])
        return slack, 1 - length[TAUT] - slack, length[TAUT]
    shares = [ufl.as_ufl(0.0)] * len(STATES)
    for point in PATH_POINTS:
        there = _is_state(film, e0 + point * (e1 - e0))
        for state in STATES.values():
            shares[state] += there[state] / len(PATH_POINTS)
    return tuple(shares)


def _is_state(film: Membrane, e: Expr) -> tuple[Expr, ...]:
    """One for the state of a film at a strain, and zero for the other two."""
    state = _state(film, e)
    return tuple(ufl.conditional(ufl.eq(state, k), 1.0, 0.0) for k in STATES.values())


def _state(film: Membrane, e: Expr) -> Expr:
    """The number of the state of a film at a strain."""
    # A law that never wrinkles has a number as its state; times `unit` it belongs to a mesh.
    unit = constant(film.space.mesh, 1.0)
    return unit * film.law.state(e, film.constants)


class AreaFractions:
    """Shares of the reference area of some films that are slack, wrinkled and taut.

    A part of a film that is taut over half of the path of the last step counts by half.

    Args:
        films: of which all areas are added up.
        at: "mean" over the last step, or "end".
        group: of cells of their meshes; empty: the whole films.

    Example:
        >>> run = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=0.1))
        >>> slack, wrinkled, taut = AreaFractions([film])(run.system)
        >>> round(float(slack + wrinkled + taut), 12)
        1.0
    """

    def __init__(self, films: Sequence[Membrane], at: At = "mean", group: str = "") -> None:
        self._of_films = ForSystem(
            lambda system: [_FilmAreas(system, film, at, group) for film in films]
        )

    def __call__(self, system: System) -> Array:
        """Return the shares (3,) of the area that are slack, wrinkled and taut; their sum is one.
        Collective."""
        areas = self.areas(system)
        return areas / areas.sum()

    def areas(self, system: System) -> Array:
        """Return the areas (3,) [m²] that are slack, wrinkled and taut.

        Collective.  Areas are those of the stress-free shape.  Warns once of a film whose states
        at the ends of steps alternate.
        """
        of_films = self._of_films(system)
        areas = np.array([of_film.measure() for of_film in of_films])
        areas = system.comm.allreduce(areas)
        # The last column is the area that is taut at one end of the last step only.
        for of_film, row in zip(of_films, areas, strict=True):
            of_film.alternation.see(system, row[-1] / row[:-1].sum())
        return areas[:, : len(STATES)].sum(axis=0)


class _FilmAreas:
    """Areas of one film by state, as compiled forms."""

    def __init__(self, system: System, film: Membrane, at: At, group: str) -> None:
        """Compile the area in a state, and that which is taut at one end of a step only;
        collective."""
        self.alternation = AlternationWatch(film, "of its area is")
        self._shape = BodyShape(system, film, at)
        dx = self._shape.body.dx
        if group:
            cells = cells_of(film, group)
            dx = dx(subdomain_data=[(1, cells)], subdomain_id=1)
        mesh = self._shape.body.space.mesh
        # One form with a constant serves the three states.
        self._which = fem.Constant(mesh, np.zeros(len(STATES)))
        shares = ufl.as_vector(state_shares(self._shape))
        self._area = compile_form(ufl.dot(shares, self._which) * dx)
        self._changed: fem.Form | None = None
        e0, e1 = self._shape.strain_path()
        if e0 is not e1 and not self._shape.body.law.quadratic:
            # A change between slack and wrinkled does not count: the sign of a strain that has no
            # stress decides which of the two it is.
            taut = [_is_state(self._shape.body, e)[TAUT] for e in (e0, e1)]
            self._changed = compile_form(abs(taut[1] - taut[0]) * dx)

    def measure(self) -> list[float]:
        """Areas [m²] of this rank's cells that are slack, wrinkled and taut, and the one that is
        taut at one end of the last step only."""
        self._shape.update()
        areas = []
        for state in STATES.values():
            self._which.value[:] = np.arange(len(STATES)) == state
            areas.append(float(fem.assemble_scalar(self._area)))
        changed = 0.0
        if self._changed is not None:
            changed = float(fem.assemble_scalar(self._changed))
        return [*areas, changed]
