"""Drag of the upper atmosphere on films and rigid bodies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
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
    InputError,
    State,
    Term,
    area_vector,
    ask,
    check,
    check_arguments,
    constant,
    positive,
)
from gossamer_fx.mechanics.orbit.environment import ROTATION
from gossamer_fx.mechanics.orbit.flight import Flight
from gossamer_fx.mechanics.orbit.flying_loads import (
    FacesForce,
    FlyingLoad,
    FlyingPointLoad,
    axes_of,
)
from gossamer_fx.mechanics.orbit.optics import (
    Accommodation,
    Air,
    Arrays,
    Surface,
    Symbolic,
    flow_force,
)
from gossamer_fx.mechanics.orbit.orbit import Orbit
from gossamer_fx.mechanics.orbit.solar_pressure import check_surfaces, geometry, surface_measure

Atmosphere = Callable[[float], Air]  # of the altitude [m]


@check_arguments
@dataclass(frozen=True)
class ExponentialAtmosphere:
    """Atmosphere whose density falls by a factor e over a scale height.

    Args:
        density: at `altitude` [kg/m³].
        altitude: reference [m].
        scale_height: [m].
        temperature: at all altitudes [K].

    Example:
        >>> atmosphere = gx.orbit.ExponentialAtmosphere(3e-12, 400e3, scale_height=60e3)
        >>> atmosphere(400e3).density
        3e-12
    """

    density: Annotated[float, positive("kg/m³")]
    altitude: float
    _: KW_ONLY
    scale_height: Annotated[float, positive("m")]
    temperature: Annotated[float, positive("K")] = 1000.0

    def __call__(self, altitude: float) -> Air:
        """The air at an altitude [m]."""
        return Air(
            self.density * math.exp((self.altitude - altitude) / self.scale_height),
            self.temperature,
        )


@check_arguments
class Drag(Item):
    """Drag of free-molecular flow on the deformed triangles of a film, or on the surfaces of a
    rigid body.

    Each triangle or surface meets the air with its own velocity; none shades another.  The air has
    the state at the altitude of the scene over a sphere, and turns about z.  It reaches both sides
    of an open film, and the outer side of a closed one.  A closed film that is convex shades
    nothing, so that its drag is complete.

    Args:
        body: a film or a rigid body.
        orbit: the orbit of the scene.
        atmosphere: a function of the altitude [m] that returns `Air`, e.g. `ExponentialAtmosphere`.
        accommodation: exchange of momentum with the surface; default: diffuse.
        surfaces: of a rigid body.
        closed: whether the film encloses a volume, with normals that point outwards, e.g. a
            balloon.
        rotation: of the atmosphere [rad/s]; default that of the Earth, on an orbit round it.
        name: for messages and results; default from the body.

    Raises:
        InputError: a film with surfaces, a rigid body without, or one that is `closed`; no rotation
            on an orbit round another centre than the Earth.

    Example:
        >>> air = gx.orbit.ExponentialAtmosphere(3e-12, 400e3, scale_height=60e3)
        >>> drag = gx.orbit.Drag(film, orbit, atmosphere=air)
    """

    def __init__(
        self,
        body: Membrane | RigidBody,
        orbit: Orbit,
        *,
        atmosphere: Atmosphere,
        accommodation: Accommodation | None = None,
        surfaces: Sequence[Surface] = (),
        closed: bool = False,
        rotation: float | None = None,
        name: str = "",
    ) -> None:
        self.body = body
        self.orbit = orbit
        self.atmosphere = atmosphere
        self.rotation = ROTATION if rotation is None else rotation
        self.accommodation = accommodation or Accommodation()
        self.surfaces = tuple(surfaces)
        self.closed = closed
        self.name = name or f"drag on {body.name}"
        check_surfaces(self.name, body, self.surfaces)
        check(
            orbit.is_round_earth or rotation is not None,
            f"'{self.name}': the orbit is not round the Earth; give the rotation of the atmosphere "
            "in rad/s, or zero.",
        )
        check(
            not closed or not isinstance(body, RigidBody),
            f"'{self.name}': closed is for films; "
            "a Surface of a rigid body is one-sided by itself.",
        )

    def requires(self) -> Iterable[Any]:
        yield self.body
        yield self.orbit

    def flow(self, flight: Flight) -> tuple[Air, Array]:
        """The air at the altitude of the origin of the frame, and its velocity Ω×R - V (3,) [m/s]
        relative to this origin, since it turns with the Earth.  Collective.  `InputError` on all
        ranks: the user's atmosphere fails or does not return `Air`."""
        # One altitude for the whole scene, which is small compared with a scale height.
        altitude = float(np.linalg.norm(flight.R)) - self.orbit.radius

        def air_there() -> Air:
            air = self.atmosphere(altitude)
            if isinstance(air, Air):
                return air
            raise InputError(f"it returns {air!r}; return Air.")

        what = f"'{self.name}': the atmosphere at {altitude:.6g} m"
        # A user's function: `ask` reports its errors in one sentence, on all ranks alike.
        air = ask(self.body.comm, what, air_there)
        # The air turns with the Earth about z; the origin moves through it with the velocity V.
        wind: Array = np.cross([0.0, 0.0, self.rotation], flight.R) - flight.V
        return air, wind

    def terms(self, start: State) -> Iterable[Term]:
        if isinstance(self.body, RigidBody):
            yield FlyingPointLoad(self.name, axes_of(self.body), self.orbit, _FlowOnFaces(self))
        else:
            yield self._on_film(self.body)

    def _on_film(self, film: Membrane) -> FlyingLoad:
        """Load of the flow on the deformed triangles of a film.  Before each step `prepare` sets
        the constants of its form: density [kg/m³], velocity and thermal speed [m/s],
        √(T_wall/T_air)."""
        mesh = film.space.mesh
        how = self.accommodation
        # Constants, whose values `prepare` sets before each step: literals in a form would compile
        # a new kernel for every value.
        # U (3,): velocity of the air relative to the origin of the frame [m/s]; ρ: its density
        # [kg/m³]; thermal: its thermal speed [m/s]; wall: √(T_wall/T_air) [-]; σn, σt:
        # accommodation coefficients of normal and tangential momentum [-].
        U = fem.Constant(mesh, np.zeros(3))
        ρ = constant(mesh, 1.0)
        thermal = constant(mesh, 1.0)
        wall = constant(mesh, 1.0)
        σn = constant(mesh, how.normal)
        σt = constant(mesh, how.tangential)
        # Air reaches both sides of an open film.
        sides = constant(mesh, 1.0 - float(self.closed))
        dx = surface_measure(film)

        def work(q: Expr, rate: Expr, w: Expr) -> ufl.Form:
            a = area_vector(film.deformation(q))
            force = flow_force(a, U - rate, thermal, σn, σt, wall, sides, Symbolic)
            return ρ * ufl.dot(force, w) * dx

        def prepare(flight: Flight, system: Assembly) -> None:
            air, U.value = self.flow(flight)
            ρ.value = air.density
            thermal.value = air.thermal_speed
            wall.value = math.sqrt(how.wall_temperature / air.temperature)

        return FlyingLoad(self.name, film, self.orbit, work, prepare)


class _FlowOnFaces(FacesForce):
    """Free-molecular flow on flat faces."""

    def __init__(self, drag: Drag) -> None:
        """Take area vectors [m²] and centres [m] of surfaces, and which of them are two-sided."""
        super().__init__(*geometry(drag.surfaces))
        self._drag = drag
        self._two_sided = np.array([float(s.two_sided) for s in drag.surfaces])[:, None]
        self._air = Air(0.0)
        self._wind: Array = np.zeros(3)

    def prepare(self, flight: Flight) -> None:
        self._air, self._wind = self._drag.flow(flight)

    def on_faces(self, areas: Array, rates: Array) -> Array:
        """Drag (..., n, 3) [N] on n faces, see `FacesForce`; NaN for a face without area or without
        relative flow."""
        how, air = self._drag.accommodation, self._air
        wall = math.sqrt(how.wall_temperature / air.temperature)
        # Velocity of the air relative to each face (..., n, 3) [m/s].
        U = self._wind - rates
        return air.density * flow_force(
            areas,
            U,
            air.thermal_speed,
            how.normal,
            how.tangential,
            wall,
            self._two_sided,
            Arrays,
        )
