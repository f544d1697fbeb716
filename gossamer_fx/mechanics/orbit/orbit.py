"""The orbit of a scene."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from weakref import WeakKeyDictionary

from gossamer_fx.core.checks.lookups import check_in_scene
from gossamer_fx.extend import Assembly, State, Term, check_arguments
from gossamer_fx.mechanics.orbit.environment import Environment
from gossamer_fx.mechanics.orbit.flight import Flight
from gossamer_fx.mechanics.orbit.relative_gravity import RelativeGravity


@check_arguments
class Orbit(Environment):
    """An orbit for the whole scene: coordinates are relative to an origin in orbit, in axes that do
    not turn.

    A mass m at x has the force of gravity less that of the accelerated frame, R being the position
    of the origin from the attracting centre:

        m [-μ X/|X|³ + μ R/|R|³ + a(X) - a(R)],   X = R + x

    a contains oblateness or harmonics, Sun and Moon, to first order in |x|/|R|.  Under 1/r gravity,
    energy and angular momentum of orbit and deformation together are conserved to the tolerance of
    the solver, for every step; `orbit.flight` describes how.  Rigid bodies have mass, centre and
    inertia, so that the forces on them lack terms of order (size/|X|)³.  Initial positions and
    velocities are relative to the origin.

    Args:
        start: `Elements`, or position [m] and velocity [m/s] of the origin, (3,) each.
        gravity: "point", "J2", or the degree 2 to 20 of EGM2008, which needs an epoch.
        epoch: UTC of the time 0, e.g. "2026-01-01T12:00:00"; needs ERFA (extra `orbit`).
        sun: from the attracting centre to the Sun [au]: three numbers, or a function of time [s]
            that returns them; default that of the epoch.  (0, 0, 0): the Sun is the centre.
        third_bodies: "sun", "moon"; need an epoch.
        shadow: of the centre: "cylinder", "cone" (with penumbra) or "none".
        mu: gravity parameter of the centre [m³/s²]; default that of the gravity field.  With that
            of another centre than the Earth, give its radius, too.
        radius: of the centre, for shadow and altitude [m]; default that of the Earth.
        pressure: of sunlight at 1 au on a black surface [N/m²].
        ut1_utc: difference UT1 - UTC of the epoch [s], below 0.9 s.
        following: time in which the origin returns to the centre of mass [s]; the motion does not
            depend on it.
        name: for messages and results.

    Raises:
        InputError: a start that is not an orbit, something that needs an epoch without one, or
            something of the Earth with the mu of another centre.

    Example:
        >>> low = gx.orbit.Orbit(gx.orbit.Elements(6.8e6, i=0.9), gravity="J2")
        >>> low.radius
        6378137.0
    """

    @cached_property
    def _flights(self) -> WeakKeyDictionary[Assembly, Flight]:
        # Weak keys: an orbit does not keep the compiled scenes of earlier runs in memory.
        return WeakKeyDictionary()

    def terms(self, start: State) -> Iterable[Term]:
        # Each compiled scene has a separate flight, so that runs may share an orbit.
        yield RelativeGravity(self.name, Flight(self), self._flights)

    def flight(self, system: Assembly) -> Flight:
        """The flight of a compiled scene; `InputError` if the orbit is not in it."""
        check_in_scene(f"'{self.name}'", system in self._flights)
        return self._flights[system]
