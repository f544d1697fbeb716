"""Probes of spinning bodies: mean spin, and polar coordinates of a point about the axis of a
frame."""

from __future__ import annotations

import math

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Body, Port, is_body
from gossamer_fx.mechanics.bodies.frames import Frame
from gossamer_fx.records.probes.points import AXES
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.view import StateView

# Quantities of `PolarPosition`
POLAR = ("radius", "angle")


@check_arguments
class MeanSpin:
    """Mean spin [rad/s] of a body about an axis through its centre of mass: ω = L/I.

    L is the angular momentum of the body and I its moment of inertia about that axis; masses that
    are attached to the body count.  In a rigid motion ω is the spin of every point; a sail that
    lags behind its hub has a lower mean spin than the hub.

    Args:
        body: a film, plate, cable, beam or mass.
        axis: "x", "y" or "z".

    Raises:
        InputError: it is not a body, or the axis is unknown.

    Example:
        >>> spin = gx.probes.MeanSpin(hub, "z")
        >>> spin(run)
        0.0
    """

    def __init__(self, body: Body, axis: str = "z") -> None:
        check(
            is_body(body), f"MeanSpin: {body!r} is not a body; give a film, plate, cable or beam."
        )
        check(
            axis in AXES, f"MeanSpin: there is no axis {axis!r}; its axes are: {', '.join(AXES)}."
        )
        self.body = body
        self.axis = axis

    def __call__(self, run: StateView) -> float:
        """The mean spin [rad/s] in the state of a run; 0 for a body without moment of inertia.

        Args:
            run: of a scene with the body.

        Raises:
            InputError: the body is not in the scene.  Collective: all ranks call it.
        """
        system = run.system
        state = system.state[self.body]
        # The two components across the axis, in the order of a positive rotation
        first = (AXES[self.axis] + 1) % 3
        plane = [first, (first + 1) % 3]
        positions = state.coordinates().reshape(-1, 3)[:, plane]
        velocities = state.rates().reshape(-1, 3)[:, plane]
        # A unit translation moves positions, not directors.
        vectors_per_node = self.body.block.size // 3
        translation = np.zeros_like(positions)
        translation[::vectors_per_node] = 1.0

        moments = self._mass_times(system, positions, plane)
        momenta = self._mass_times(system, velocities, plane)
        masses = self._mass_times(system, translation, plane)
        angular = positions[:, 0] * momenta[:, 1] - positions[:, 1] * momenta[:, 0]
        own_sums = np.array(
            [
                (positions * moments).sum(),
                angular.sum(),
                *(translation * masses).sum(axis=0),
                *(translation * moments).sum(axis=0),
                *(translation * momenta).sum(axis=0),
            ]
        )
        sums = run.comm.allreduce(own_sums)
        # The mass of the two directions is the same number, unless the mass is not isotropic.
        mass, first_moment, momentum = sums[2:].reshape(3, 2)
        # Steiner: from the axis through the origin to that through the centre of mass
        inertia = sums[0] - (first_moment**2 / mass).sum()
        orbital = first_moment[0] * momentum[1] - first_moment[1] * momentum[0]
        angular_momentum = sums[1] - orbital / mass[0]
        if inertia <= 0:
            return 0.0
        return float(angular_momentum / inertia)

    def _mass_times(self, system: System, values: Array, plane: list[int]) -> Array:
        """The product of the mass matrix with vectors of the body in a plane.  Collective.

        All other bodies have zero: what the mass matrix couples to the body does not count.

        Args:
            values: (n, 2) of this rank's n vectors (positions and directors), e.g. in m or m/s.

        Returns:
            products (n, 2), in the unit of the values times kg.
        """
        owned = system.state[self.body].part
        alone = system.q0.duplicate()
        product = system.q0.duplicate()
        alone.set(0.0)
        with alone as entries:
            entries[owned].reshape(-1, 3)[:, plane] = values
        system.M.mult(alone, product)
        result: Array = product.array_r[owned].reshape(-1, 3)[:, plane].copy()
        alone.destroy()
        product.destroy()
        return result


@check_arguments
class PolarPosition:
    """Polar coordinate of a point about the third axis of a frame: radius [m], or angle [rad].

    The angle is measured from the first axis of the frame and lies between -π and π.  In the frame
    of a hub the angle of a tip is the twist of the sail.

    Args:
        port: a point of a body.
        frame: with three directors, of a body or of the ground.
        quantity: "radius" or "angle".

    Raises:
        InputError: the quantity is unknown, or the frame has two directors only.

    Example:
        >>> twist = gx.probes.PolarPosition(mass.port(), hub.frame(), quantity="angle")
    """

    def __init__(self, port: Port, frame: Frame, *, quantity: str = "radius") -> None:
        check(
            quantity in POLAR,
            f"PolarPosition: there is no {quantity!r}; choose from {', '.join(POLAR)}.",
        )
        check(
            len(frame.directors) == 3,
            "PolarPosition: the frame has no third axis; give one with three directors.",
        )
        self.port = port
        self.frame = frame
        self.quantity = quantity

    def __call__(self, run: StateView) -> float:
        """The radius [m], or the angle [rad] in -π to π, in the state of a run.

        Args:
            run: of a scene with the bodies of point and frame.

        Raises:
            InputError: a body is not in the scene.  Collective: all ranks call it.
        """
        ports = [self.port, self.frame.origin, *self.frame.directors]
        point, origin, first_axis, second_axis, _ = run.system.state.vectors(ports)
        arm = point - origin
        along_first = float(arm @ first_axis)
        along_second = float(arm @ second_axis)
        if self.quantity == "radius":
            return math.hypot(along_first, along_second)
        return math.atan2(along_second, along_first)
