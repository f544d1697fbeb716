"""Pressure of sunlight on films and rigid bodies."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.extend import (
    Array,
    Assembly,
    Expr,
    State,
    Term,
    area_vector,
    check,
    check_arguments,
    constant,
)
from gossamer_fx.mechanics.bodies import Membrane, RigidBody
from gossamer_fx.mechanics.orbit.flight import Flight
from gossamer_fx.mechanics.orbit.flying_loads import (
    FacesForce,
    FlyingLoad,
    FlyingPointLoad,
    axes_of,
)
from gossamer_fx.mechanics.orbit.optics import MIRROR, Optics
from gossamer_fx.mechanics.orbit.orbit import Orbit
from gossamer_fx.mechanics.orbit.shadow_map import ShadowMap
from gossamer_fx.mechanics.orbit.surface_forces import Rows, Surface, Symbolic, light_force

# Largest number of pixels across the map of shadows: their square has to fit in memory on every
# rank.
MAX_SHADOW_PIXELS = 8192


@check_arguments
class SolarPressure:
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
        shadow_pixels: int = 0,
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
            f"'{self.name}': only films have groups; give the optics of a rigid body with its "
            "surfaces.",
        )
        check(
            shadow_pixels >= 0 and (not shadow_pixels or isinstance(body, Membrane)),
            f"'{self.name}': shadow_pixels is {shadow_pixels!r}; give pixels across a film, or "
            "zero.",
        )
        check(
            shadow_pixels <= MAX_SHADOW_PIXELS,
            f"'{self.name}': shadow_pixels is {shadow_pixels!r}; give at most {MAX_SHADOW_PIXELS}.",
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
        """Load of sunlight on the deformed triangles of a film; direction and pressure are
        constants.

        Returns:
            the load term: the form of its virtual work (forces [N] tested by w), and `prepare`,
            which sets direction (3,), pressure [N/m²] and shadows before each step.

        Raises:
            InputError: a group of optics is not of triangles of the mesh.
        """
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
    """Optical coefficients of front and back: constants, or functions where groups of triangles
    differ.

    Each rank sets the values of the triangles that it owns, and of its ghosts.

    Args:
        film: the film.
        optics: of all triangles that are in none of the groups.
        groups: optics by the names of groups of its mesh.
        name: of the load, for messages.

    Returns:
        for front and back a list of three dimensionless UFL scalars, those of
        `Optics.coefficients`.

    Raises:
        InputError: a group that is not in the mesh, or not of triangles.
    """
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
        dim, cells = film.mesh.group(group)
        check(
            dim == 2,
            f"'{name}': the group '{group}' has dimension {dim}; name triangles of the mesh.",
        )
        rows[cells] = np.concatenate([others.coefficients(back=side) for side in (False, True)])
    return [table[i] for i in range(3)], [table[i] for i in range(3, 6)]


def check_surfaces(name: str, body: Membrane | RigidBody, surfaces: Sequence[Surface]) -> None:
    """Raise `InputError` unless a rigid body has surfaces and a film has none.

    Args:
        name: of the load, for the message.
        body: on which the load acts.
        surfaces: flat faces that the user gave for the body.

    Raises:
        InputError: the body is neither a film nor a rigid body, or surfaces are missing or
            superfluous.
    """
    check(
        isinstance(body, Membrane | RigidBody),
        f"'{name}' acts on {body!r}; give a film or a rigid body.",
    )
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
    return ufl.Measure(
        "dx", film.space.mesh, metadata={"quadrature_degree": 1 if film.order == 1 else 4}
    )


class _LightOnFaces(FacesForce):
    """Sunlight on flat faces."""

    def __init__(self, surfaces: Sequence[Surface]) -> None:
        """Take geometry and optical coefficients (3, n, 1) [-] of both sides of n surfaces.

        Args:
            surfaces: flat faces of a rigid body, with area [m²], normal, centre [m] and optics.
                The back of a one-sided face has the coefficients zero.
        """
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

    def on_faces(self, areas: Array, positions: Array, rates: Array) -> Array:
        f: Array = self._P * light_force(areas, self._u, self._front, self._back, Rows)
        return f


def geometry(surfaces: Sequence[Surface]) -> tuple[Array, Array]:
    """Area vectors and centres (n, 3)."""
    # Normals are given with any length.
    areas = [s.area * np.asarray(s.normal, dtype=float) / math.hypot(*s.normal) for s in surfaces]
    return np.array(areas), np.array([s.centre for s in surfaces], dtype=float)
