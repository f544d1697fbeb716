"""What attracts and lights a scene in orbit, as functions of position and time: gravity of the
central body, Sun and Moon, and sunlight with the shadow of the central body."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import Range
from gossamer_fx.core.model.item import Item
from gossamer_fx.extend import Array, Vector, ask_numbers, check, is_vector, positive
from gossamer_fx.mechanics.orbit.elements import Elements
from gossamer_fx.mechanics.orbit.harmonics import (
    EARTH_MU,
    EARTH_RADIUS,
    EGM_DEGREE,
    EGM_MU,
    SolidHarmonics,
    egm2008,
    oblateness,
)
from gossamer_fx.mechanics.orbit.optics import PRESSURE
from gossamer_fx.mechanics.orbit.sky import (
    AU,
    MU_MOON,
    MU_SUN,
    Sky,
    point_gradient,
    shadow_depth,
    sunlit_in_cone,
    sunlit_in_cylinder,
    third_body,
    third_body_gradient,
)

Shadow = Literal["none", "cylinder", "cone"]
SunHistory = Callable[[float], Sequence[float]]
ROTATION = 7.292115e-5  # rad/s, of the Earth

# Values of the Earth's gravity parameter differ by less than this part.
SAME_CENTRE = 1e-3


class Environment(Item):
    """What attracts and lights a scene; its arguments are those of `Orbit`."""

    def __init__(
        self,
        start: Elements | tuple[Vector, Vector],
        *,
        gravity: Literal["point", "J2"] | Annotated[int, Range(2, EGM_DEGREE)] = "point",
        epoch: str | None = None,
        sun: Vector | SunHistory | None = None,
        third_bodies: Sequence[Literal["sun", "moon"]] = (),
        shadow: Shadow = "cylinder",
        mu: Annotated[float, positive("m³/s²")] | None = None,
        radius: Annotated[float, positive("m")] | None = None,
        pressure: Annotated[float, positive("N/m²")] = PRESSURE,
        ut1_utc: float = 0.0,
        following: Annotated[float, positive("s")] = 1000.0,
        name: str = "orbit",
    ) -> None:
        """Check the arguments of an `Orbit`; build gravity field, sky and initial state.
        `InputError`: an argument is out of its range or not one of the named choices, `epoch` is
        missing where the gravity field or a third body depends on the date, or the library ERFA for
        dates is not installed."""
        self.name = name
        self.is_round_earth = mu is None or abs(mu / EARTH_MU - 1) <= SAME_CENTRE
        check(
            self.is_round_earth
            or (gravity == "point" and not epoch and not third_bodies and radius is not None),
            f"Orbit '{name}': mu is {mu!r} m³/s², not that of the Earth; give the radius of the "
            "centre and leave out gravity, epoch and third_bodies, which are the Earth's.",
        )
        self.radius = EARTH_RADIUS if radius is None else radius
        self.pressure = pressure
        self.following = following
        # Arguments that a restart compares, see `records.outputs.output`.
        self._start = start
        self._gravity = gravity
        self._epoch = epoch
        self._ut1_utc = ut1_utc
        self.shadow: Shadow = shadow
        self._harmonics: SolidHarmonics | None = None
        if gravity == "J2":
            self._harmonics = oblateness(mu=EARTH_MU if mu is None else mu)
        elif gravity != "point":
            assert isinstance(gravity, int)
            self._harmonics = egm2008(gravity)
        # Harmonics of a degree depend on the longitude; J2 alone is the same at all of them.
        self._turns = isinstance(gravity, int)
        # The coefficients of EGM2008 belong to its value of μ.
        self.mu = mu if mu is not None else EGM_MU if self._turns else EARTH_MU
        self._third_bodies = tuple(third_bodies)
        check(
            epoch is not None or not (self._turns or self._third_bodies),
            f"Orbit '{name}': harmonics of a turning Earth, and Sun and Moon, need a date; "
            "give an epoch.",
        )
        self.sky = Sky(epoch, ut1_utc) if epoch is not None else None
        check(
            sun is None
            or callable(sun)
            or (is_vector(sun) and (bool(np.any(sun)) or self.mu > MU_SUN / 2)),
            f"Orbit '{name}': sun is {sun!r}; give three numbers in astronomical units, "
            "or a function of time; only an orbit with the Sun's mu has it at its centre.",
        )
        self._sun = sun
        self.state = self._state_of(start)

    def _state_of(self, start: Elements | tuple[Vector, Vector]) -> tuple[Array, Array]:
        """Position [m] and velocity [m/s], (3,) each, of orbital elements or as they are given;
        `InputError` for anything else, or a position within the attracting body."""
        if isinstance(start, Elements):
            state = start.state(self.mu)
        else:
            position, velocity = (np.asarray(s, dtype=float) for s in start)
            state = (position, velocity)
        distance = float(np.linalg.norm(state[0]))
        check(
            distance >= self.radius,
            f"Orbit '{self.name}' starts {distance:.6g} m from the centre of a body with a radius "
            f"of {self.radius:.6g} m; give another start, or the radius of the body.",
        )
        return state

    # ---- what attracts ---------------------------------------------------------------------------

    @property
    def is_perturbed(self) -> bool:
        """Whether more attracts than a point."""
        return self._harmonics is not None or bool(self._third_bodies)

    def field(self, r: Array, t: float) -> Array:
        """Perturbing acceleration (3,) [m/s²] at r (3,) [m] from the attracting centre, in axes
        that do not turn, t [s] after the epoch: oblateness or harmonics and the tides of Sun and
        Moon, zero if there are none."""
        a: Array = np.zeros(3)
        if self._harmonics is not None:
            E = self.earth(t)
            # Harmonics are functions of Earth-fixed coordinates.
            a += E.T @ self._harmonics.gradient(E @ r)
        for position, mu in self._bodies(t):
            a += third_body(r, position, mu)
        return a

    def gradient(self, r: Array, t: float) -> Array:
        """Derivative (3, 3) [1/s²] of `field` with respect to r (3,) [m], at time t [s]."""
        G: Array = np.zeros((3, 3))
        if self._harmonics is not None:
            E = self.earth(t)
            G += E.T @ self._harmonics.second_gradient(E @ r) @ E
        for position, mu in self._bodies(t):
            G += third_body_gradient(r, position, mu)
        return G

    def tide(self, r: Array) -> Array:
        """Derivative μ/|r|³ (1 - 3 r̂r̂ᵀ) (3, 3) [1/s²] of μ r/|r|³, the opposite of the attraction
        by the central body, at r (3,) [m] from it."""
        return point_gradient(r, self.mu)

    def _bodies(self, t: float) -> Iterable[tuple[Array, float]]:
        """Positions (3,) [m] of the third bodies at time t [s], each with its μ [m³/s²]."""
        if self.sky is not None and self._third_bodies:
            if "sun" in self._third_bodies:
                yield self.sky.sun(t), MU_SUN
            if "moon" in self._third_bodies:
                yield self.sky.moon(t), MU_MOON

    def earth(self, t: float) -> Array:
        """Rotation (3, 3) from the axes of the scene to Earth-fixed axes at time t [s]; without an
        epoch both agree at time 0, and the Earth turns about z."""
        if self.sky is not None:
            return self.sky.earth(t)
        # The true angle is unknown without an epoch; J2, which is symmetric about z, needs none.
        c, s = math.cos(ROTATION * t), math.sin(ROTATION * t)
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])

    # ---- what lights -----------------------------------------------------------------------------

    def sun(self, t: float) -> Array:
        """Position (3,) [m] of the Sun from the attracting centre, t [s] after the start of the
        run; zero if the Sun is the centre.  `InputError`: neither `sun` nor an epoch was given to
        the orbit, or the user's function `sun` does not return three finite numbers."""
        if self._sun is None:
            check(
                self.sky is not None,
                f"Orbit '{self.name}' does not know where the Sun is; give it `sun`, or an epoch.",
            )
            assert self.sky is not None
            return self.sky.sun(t)
        value = self._sun(t) if callable(self._sun) else self._sun
        check(
            is_vector(value),
            f"Orbit '{self.name}': the Sun is at {value!r} au at t = {t:.6g} s; "
            "give three numbers.",
        )
        return AU * np.asarray(value, dtype=float)

    def compare_sun(self, comm: MPI.Intracomm, t: float) -> None:
        """`InputError` on all ranks unless a user's function `sun` returns three finite numbers
        [au] at t [s], the same on all ranks.  Collective."""
        given = self._sun
        if callable(given):
            what = f"Orbit '{self.name}': its sun at t = {t:.6g} s"
            ask_numbers(comm, what, lambda: given(t), (3,))

    def light(self, r: Array, t: float) -> tuple[Array, float]:
        """Unit vector (3,) away from the Sun at r (3,) [m] from the attracting centre, t [s] after
        the start of the run, and the pressure [N/m²] of sunlight on a black surface, reduced by the
        shadow, to zero in the umbra."""
        sun = self.sun(t)
        way = r - sun
        distance = float(np.linalg.norm(way))
        # The pressure of sunlight falls with the square of the distance from the Sun.
        return way / distance, self.pressure * (AU / distance) ** 2 * self.sunlit(r, sun)

    def sunlit(self, r: Array, sun: Array) -> float:
        """Fraction, 0 to 1, of the Sun at `sun` (3,) [m] that is seen from r (3,) [m], both from
        the attracting centre."""
        # A Sun in the centre casts no shadow: nothing lies between it and the scene.
        if self.shadow == "none" or not np.any(sun):
            return 1.0
        sunlit = sunlit_in_cone if self.shadow == "cone" else sunlit_in_cylinder
        return sunlit(r, sun, self.radius)

    def depth(self, r: Array, t: float) -> float:
        """How deep r is in the cylinder of the shadow [m]; negative outside.  `InputError`: the Sun
        is the attracting centre, which casts no shadow."""
        sun = self.sun(t)
        check(
            bool(np.any(sun)),
            f"Orbit '{self.name}': the Sun is its centre, which casts no shadow; "
            "leave the depth in it out.",
        )
        return shadow_depth(r, sun, self.radius)

    # ---- axes ------------------------------------------------------------------------------------

    @cached_property
    def local_axes(self) -> Array:
        """Rotation matrix (3, 3) at the start, with the columns outward, along and across the
        orbit."""
        return local_axes(*self.state)


def local_axes(r: Array, v: Array) -> Array:
    """Rotation matrix (3, 3) of a position r (3,) [m] and a velocity v (3,) [m/s]: its columns are
    away from the centre, in the plane of the orbit along the motion, and normal to it."""
    out = r / np.linalg.norm(r)
    across = np.cross(r, v)
    across /= np.linalg.norm(across)
    return np.column_stack([out, np.cross(across, out), across])
