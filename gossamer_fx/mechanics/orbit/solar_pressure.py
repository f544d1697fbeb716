"""Pressure of sunlight on films and rigid bodies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Annotated, Any

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx import Membrane, RigidBody
from gossamer_fx.core.model.item import Item
from gossamer_fx.extend import (
    Array,
    Assembly,
    Expr,
    Load,
    Range,
    State,
    Term,
    area_vector,
    ask_numbers,
    check,
    check_arguments,
    constant,
    not_negative,
)
from gossamer_fx.mechanics.bodies.properties import cells_of_group
from gossamer_fx.mechanics.orbit.flight import Flight
from gossamer_fx.mechanics.orbit.flying_loads import (
    FacesForce,
    FlyingLoad,
    FlyingPointLoad,
    axes_of,
)
from gossamer_fx.mechanics.orbit.optics import (
    MIRROR,
    PRESSURE,
    Arrays,
    Optics,
    Surface,
    Symbolic,
    light_force,
)
from gossamer_fx.mechanics.orbit.orbit import Orbit
from gossamer_fx.mechanics.orbit.shadow_map import ShadowMap

# Largest number of pixels across the map of shadows: their square has to fit in memory on every
# rank.
Pixels = Annotated[int, Range(0, 8192)]


@check_arguments
class SolarPressure(Item):
    """Pressure of sunlight on the deformed triangles of a film, or on the surfaces of a rigid body;
    see `Optics`.

    Both sides of a film are considered.  Distance from the Sun and shadow of the central body are
    those at the middle of the step.

    Args:
        body: a film or a rigid body.
        orbit: the orbit of the scene.
        optics: of a film; the front is the side to which the normal of the mesh points.
        groups: optics by the names of groups of its triangles.
        surfaces: of a rigid body.
        shadow_pixels: pixels across the map by which a film's shadow on itself is found at the
            start of each step; 0: none.
        name: for messages and results; default from the body.

    Raises:
        InputError: a film with surfaces, a rigid body without, or a group that is not of triangles.

    Example:
        >>> sail = gx.orbit.Optics(0.88, 0.94)
        >>> light = gx.orbit.SolarPressure(film, orbit, optics=sail)
    """

    def __init__(
        self,
        body: Membrane | RigidBody,
        orbit: Orbit,
        *,
        optics: Optics = MIRROR,
        groups: Mapping[str, Optics] | None = None,
        surfaces: Sequence[Surface] = (),
        shadow_pixels: Pixels = 0,
        name: str = "",
    ) -> None:
        self.body = body
        self.orbit = orbit
        self.optics = optics
        self.groups = dict(groups or {})
        self.surfaces = tuple(surfaces)
        self.shadow_pixels = shadow_pixels
        self.name = name or f"sunlight on {body.name}"
        check_surfaces(self.name, body, self.surfaces)
        check(
            not self.groups or isinstance(body, Membrane),
            f"'{self.name}': only films have groups; "
            "give the optics of a rigid body with its surfaces.",
        )
        check(
            not shadow_pixels or isinstance(body, Membrane),
            f"'{self.name}': shadow_pixels is {shadow_pixels!r}; "
            "give pixels across a film, or zero.",
        )

    def requires(self) -> Iterable[Any]:
        yield self.body
        yield self.orbit

    def terms(self, start: State) -> Iterable[Term]:
        if isinstance(self.body, RigidBody):
            yield FlyingPointLoad(
                self.name, axes_of(self.body), self.orbit, _LightOnFaces(self.surfaces)
            )
        else:
            yield self._on_film(self.body)

    def _on_film(self, film: Membrane) -> FlyingLoad:
        """Load of sunlight on the deformed triangles of a film.  Before each step `prepare` sets
        direction (3,), pressure [N/m²] and shadows."""
        mesh = film.space.mesh
        # u: unit vector along the light; P: pressure of sunlight on a black surface [N/m²], zero
        # until the first step.
        u = fem.Constant(mesh, np.zeros(3))
        P = constant(mesh, 0.0)
        front, back = face_coefficients(film, self.optics, self.groups, self.name)
        dx = surface_measure(film)
        shades = ShadowMap(film, self.shadow_pixels) if self.shadow_pixels else None
        # The kernel of a film without shadows has no function on its triangles to read.
        pressure = P if shades is None else P * shades.lit

        def work(q: Expr, rate: Expr, w: Expr) -> ufl.Form:
            force = light_force(area_vector(film.deformation(q)), u, front, back, Symbolic)
            return pressure * ufl.dot(force, w) * dx

        def prepare(flight: Flight, system: Assembly) -> None:
            """Set direction and pressure [N/m²] of sunlight, and the shadows, for a step."""
            direction, P.value = flight.light()
            u.value = direction
            if shades is not None:
                # Once a step, for the shape at its start: the iteration of the step sees constant
                # light.
                shades.update(system, direction)

        return FlyingLoad(self.name, film, self.orbit, work, prepare)


def face_coefficients(
    film: Membrane, optics: Optics, groups: Mapping[str, Optics], name: str
) -> tuple[list[Expr], list[Expr]]:
    """Three UFL scalars, those of `Optics.coefficients`, for the front of a film and for its back:
    constants, or functions where groups of triangles, by their names, have other optics than the
    others.  Each rank sets the values of the triangles that it owns, and of its ghosts."""
    mesh = film.space.mesh
    both = [optics.coefficients(back=side) for side in (False, True)]
    # Six constants are cheaper than a function of six values on each triangle.
    if not groups:
        front, back = ([constant(mesh, c) for c in side] for side in both)
        return front, back
    table = fem.Function(fem.functionspace(mesh, ("DG", 0, (6,))))
    rows = table.x.array.reshape(-1, 6)
    rows[:] = np.concatenate(both)
    for group, others in groups.items():
        cells = cells_of_group(film.mesh, group, f"'{name}'")
        rows[cells] = np.concatenate([others.coefficients(back=side) for side in (False, True)])
    return [table[i] for i in range(3)], [table[i] for i in range(3, 6)]


def check_surfaces(name: str, body: Membrane | RigidBody, surfaces: Sequence[Surface]) -> None:
    """Raise `InputError` unless the body of a load is a rigid body with surfaces or a film
    without."""
    if isinstance(body, RigidBody):
        check(bool(surfaces), f"'{name}': the rigid body '{body.name}' has no surfaces; give some.")
    else:
        check(
            not surfaces,
            f"'{name}': the faces of the film '{body.name}' are its triangles; give no surfaces.",
        )


def surface_measure(film: Membrane) -> ufl.Measure:
    """dx of forces on the deformed faces: constant on triangles of order 1."""
    # On a plane triangle the force is constant; the normal of a curved one varies.
    return film.surface_measure(1 if film.order == 1 else 4)


class _LightOnFaces(FacesForce):
    """Sunlight on flat faces."""

    def __init__(self, surfaces: Sequence[Surface]) -> None:
        """Take geometry and optical coefficients (3, n, 1) of both sides of n surfaces; the back of
        a one-sided face has the coefficients zero."""
        super().__init__(*geometry(surfaces))
        self._front, self._back = (
            np.array([s.optics.coefficients(back=side) for s in surfaces]).T[..., None]
            for side in (False, True)
        )
        # The back of a one-sided surface is inside of the body, without light.
        self._back *= np.array([s.two_sided for s in surfaces])[:, None]
        # Direction (3,) of the light and its pressure [N/m²]; `prepare` sets them for each step.
        self._u: Array = np.zeros(3)
        self._P = 0.0

    def prepare(self, flight: Flight) -> None:
        self._u, self._P = flight.light()

    def on_faces(self, areas: Array, rates: Array) -> Array:
        """Forces (..., n, 3) [N] of light on n faces, whatever their velocities are."""
        return self._P * light_force(areas, self._u, self._front, self._back, Arrays)


def geometry(surfaces: Sequence[Surface]) -> tuple[Array, Array]:
    """Area vectors [m²] and centres [m] of n surfaces in body axes, (n, 3) each."""
    # Normals are given with any length.
    areas = [s.area * np.asarray(s.normal, dtype=float) / math.hypot(*s.normal) for s in surfaces]
    return np.array(areas), np.array([s.centre for s in surfaces], dtype=float)


# ---- sunlight without an orbit -------------------------------------------------------------------

Direction = Sequence[float] | Callable[[float], Sequence[float]]


@check_arguments
class Sunlight(Item):
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
        pressure: Annotated[float, not_negative("N/m²")] = PRESSURE,
        name: str = "sunlight",
    ) -> None:
        self.body = body
        self.optics = optics
        self.groups = dict(groups or {})
        self.pressure = pressure
        self.name = name
        self._direction = direction
        self.direction_at(0.0)

    def requires(self) -> Iterable[Any]:
        yield self.body

    def direction_at(self, t: float) -> Array:
        """Unit vector (3,) along which the light travels at a time [s], or the argument `at` of an
        equilibrium; `InputError` unless the direction is three finite numbers, not all zero.
        Collective."""
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
        return u / length

    def terms(self, start: State) -> Iterable[Term]:
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
