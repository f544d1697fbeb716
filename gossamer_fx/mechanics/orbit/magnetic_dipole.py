"""The torque of the Earth's magnetic field on a dipole."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from gossamer_fx.core.model.item import Item
from gossamer_fx.extend import (
    Array,
    Port,
    State,
    Term,
    Vector,
    ask_numbers,
    check,
    check_arguments,
)
from gossamer_fx.mechanics.bodies.frames import FullFrame
from gossamer_fx.mechanics.orbit.flight import Flight
from gossamer_fx.mechanics.orbit.flying_loads import FlyingPointLoad
from gossamer_fx.mechanics.orbit.harmonics import Igrf
from gossamer_fx.mechanics.orbit.orbit import Orbit

MomentHistory = Callable[[float], Sequence[float]]


@check_arguments
class MagneticDipole(Item):
    """Torque m × B of the Earth's magnetic field B on a dipole m that is fixed in a frame.

    B is that of IGRF-14 at the position of the frame.  The torque is distributed to the directors
    as by `Torque`, so that a step h changes the angular momentum by exactly h m × B.

    Args:
        frame: of a rigid body, with three directors.
        orbit: the orbit of the scene, with an epoch.
        moment: components along the directors [A m²]: three numbers, or a function of time [s] that
            returns them.
        name: for messages and results.

    Raises:
        InputError: the frame has not three directors, the orbit has no epoch, or IGRF-14 does not
            cover the year.

    Example:
        >>> try:
        ...     magnet = gx.orbit.MagneticDipole(hub.frame(), orbit, moment=(0.0, 0.0, 1.5))
        ... except gx.InputError as error:
        ...     print("epoch" in str(error))
        True
    """

    def __init__(
        self,
        frame: FullFrame,
        orbit: Orbit,
        *,
        moment: Vector | MomentHistory,
        name: str = "magnet",
    ) -> None:
        self.frame = frame
        self.orbit = orbit
        self.moment = moment
        self.name = name
        check(
            orbit.sky is not None,
            f"'{name}': the magnetic field turns with the Earth; give the orbit an epoch.",
        )
        # The field changes by less than a percent a year: that of the epoch serves the whole run.
        self._field = Igrf(orbit.sky.year) if orbit.sky is not None else None

    def requires(self) -> Iterable[Any]:
        yield from (p.body for p in self.frame.directors if isinstance(p, Port))
        yield self.orbit

    def field(self, flight: Flight) -> Array:
        """B (3,) [T] in the axes of the scene, in the middle of the step."""
        assert self._field is not None
        # IGRF is a field in Earth-fixed axes.
        turn = self.orbit.earth(flight.time)
        return turn.T @ self._field.field(turn @ flight.R)

    def terms(self, start: State) -> Iterable[Term]:
        yield FlyingPointLoad(self.name, self.frame.directors, self.orbit, _DipoleTorque(self))


class _DipoleTorque:
    """Forces F × d_k on directors d_k with (tr S 1 - S) F = m × B, S = Σ d_k d_kᵀ."""

    def __init__(self, dipole: MagneticDipole) -> None:
        self._dipole = dipole
        # Field [T] and moment [A m²] of the step; `prepare` sets them.
        self._B: Array = np.zeros(3)
        self._m: Array = np.zeros(3)

    def prepare(self, flight: Flight) -> None:
        """Take the field B (3,) [T] and the moment m (3,) [A m²] in the middle of the step."""
        moment = self._dipole.moment
        # Loads of the midpoint rule act in the middle of the step.
        if callable(moment):
            what = f"'{self._dipole.name}': its moment at t = {flight.time:.6g} s"
            body = next(iter(self._dipole.requires()))
            self._m = ask_numbers(body.comm, what, lambda: moment(flight.time), (3,))
        else:
            self._m = np.asarray(moment, dtype=float)
        self._B = self._dipole.field(flight)

    def forces(self, X: Array, rate: Array) -> Array:
        """Forces (..., 3, 3) [N m], conjugate to the directors X (..., 3, 3) [-], whose torque is m
        × B."""
        torque = np.cross(self._m @ X, self._B)
        # In the middle of a step directors are not exactly orthonormal; with the S of these
        # directors the torque is still m × B.  F [N m] is the torque over tr(S) 1 - S.
        S = np.swapaxes(X, -1, -2) @ X
        resistance = np.trace(S, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - S
        F = np.linalg.solve(resistance, torque[..., None])[..., 0]
        return np.cross(F[..., None, :], X)
