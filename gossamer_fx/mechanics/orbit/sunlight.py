"""Sunlight from a given direction on a film, for scenes without an orbit: equilibria, modes, tests
on the ground."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.extend import (
    Array,
    Expr,
    Load,
    State,
    Term,
    area_vector,
    ask_numbers,
    check,
    check_arguments,
    constant,
)
from gossamer_fx.mechanics.bodies import Membrane
from gossamer_fx.mechanics.orbit.optics import MIRROR, PRESSURE, Optics
from gossamer_fx.mechanics.orbit.solar_pressure import face_coefficients, surface_measure
from gossamer_fx.mechanics.orbit.surface_forces import Symbolic, light_force

Direction = Sequence[float] | Callable[[float], Sequence[float]]


@check_arguments
class Sunlight:
    """Pressure of light from a given direction on the deformed triangles of a film; see `Optics`.

    In an orbit take `SolarPressure`, which knows distance and shadow, too.

    Args:
        body: the film; both sides are considered.
        direction: along which the light travels (3,), of any length, or a function of time [s] (of
            the argument `at` of an equilibrium) that returns it.
        optics: the front is the side to which the normal of the mesh points.
        groups: optics by the names of groups of triangles.
        pressure: of the light on a surface that absorbs it [N/m²]; default that at 1 astronomical
            unit.
        name: for messages and results.

    Raises:
        InputError: a direction that is not three finite numbers, or zero; a pressure that is
            negative; a group that is not of triangles.

    Example:
        >>> light = gx.orbit.Sunlight(film, direction=(0.0, 0.0, -1.0))
        >>> turning = gx.orbit.Sunlight(film, direction=lambda t: (np.sin(t), 0.0, -np.cos(t)))
    """

    def __init__(
        self,
        body: Membrane,
        *,
        direction: Direction,
        optics: Optics = MIRROR,
        groups: Mapping[str, Optics] | None = None,
        pressure: float = PRESSURE,
        name: str = "sunlight",
    ) -> None:
        self.body = body
        self.optics = optics
        self.groups = dict(groups or {})
        self.pressure = pressure
        self.name = name
        check(
            np.isfinite(pressure) and pressure >= 0,
            f"'{name}': pressure is {pressure!r} N/m²; give zero or a positive number.",
        )
        self._direction = direction
        self.direction_at(0.0)

    def requires(self) -> Iterable[Any]:
        yield self.body

    def direction_at(self, t: float) -> Array:
        """Unit vector (3,) along which the light travels at a time.  Collective.

        Args:
            t: time [s], or the argument `at` of an equilibrium.

        Raises:
            InputError: the direction is not three finite numbers, or has no length.
        """
        what = f"'{self.name}': direction"
        given = self._direction
        if callable(given):
            u = ask_numbers(self.body.comm, f"{what} at t = {t:g} s", lambda: given(t), (3,))
        else:
            u = np.asarray(given, dtype=float)
        length = float(np.linalg.norm(u)) if u.shape == (3,) else 0.0
        check(
            np.isfinite(length) and length > 0,
            f"{what} is {given!r}; give three finite numbers that are not all zero.",
        )
        unit: Array = u / length
        return unit

    def terms(self, start: State) -> Iterable[Term]:
        """Yield the force of light on the deformed triangles, a load that follows them.

        Raises:
            InputError: a group of optics is not of triangles of the mesh.
        """
        film = self.body
        mesh = film.space.mesh
        # u: unit vector along the light at t = 0, P: pressure on a black surface [N/m²].
        u = fem.Constant(mesh, self.direction_at(0.0))
        P = constant(mesh, self.pressure)
        front, back = face_coefficients(film, self.optics, self.groups, self.name)
        dx = surface_measure(film)

        def work(q: Expr, w: Expr) -> ufl.Form:
            force = light_force(area_vector(film.deformation(q)), u, front, back, Symbolic)
            return P * ufl.dot(force, w) * dx

        def turn(t: float) -> None:
            """Take the direction at a time."""
            u.value = self.direction_at(t)

        yield Load(self.name, film, work, follows=True, at=turn)
