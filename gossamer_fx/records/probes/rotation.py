"""Probes of what turns: angular momentum, nutation, spin, and waves of a film around an axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np

from gossamer_fx.core.checks.arguments import at_least, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Body, Port
from gossamer_fx.mechanics.bodies.frames import Frame, FullFrame
from gossamer_fx.mechanics.terms.loads import PointLoads
from gossamer_fx.records.probes.points import AXES, AxisName
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.view import StateView


@check_arguments
class AngularMomentum:
    """Component [kg m²/s] of the angular momentum of the scene about its centre of mass.

    In axes of space it is constant without external loads.  In the axes of a hub its first two
    components grow as the hub leans away from it.

    Args:
        axis: "x", "y" or "z": of space, or the first, second or third axis of `frame`.
        frame: with three directors, of a body or of the ground; None: axes of space.

    Raises:
        InputError: the axis is unknown, or the frame has two directors only.

    Example:
        >>> along_hub = gx.probes.AngularMomentum("z", frame=hub.frame())
        >>> along_hub(run)
        0.0
    """

    unit = "kg m²/s"

    def __init__(self, axis: AxisName, *, frame: FullFrame | None = None) -> None:
        self.axis: AxisName = axis
        self.frame = frame

    def __call__(self, run: StateView) -> float:
        """The component [kg m²/s] in the state of a run."""
        momentum = angular_momentum_about_centre(run)
        if self.frame is None:
            return float(momentum[AXES[self.axis]])
        director = self.frame.directors[AXES[self.axis]]
        return float(momentum @ run.system.unknowns.state.vectors([director])[0])


@check_arguments
class Nutation:
    """Angle [rad], 0 to π, between the third axis of a frame and the scene's angular momentum about
    its centre of mass.

    The nutation angle of a rigid symmetric body is constant; where energy is dissipated it decays
    if the third axis is that of the largest moment of inertia, and grows otherwise.

    Args:
        frame: with three directors, of a body.

    Raises:
        InputError: the frame has two directors only.

    Example:
        >>> nutation = gx.probes.Nutation(hub.frame())
    """

    unit = "rad"

    def __init__(self, frame: FullFrame) -> None:
        self.frame = frame

    def __call__(self, run: StateView) -> float:
        """The angle [rad] in the state of a run; 0 where nothing turns."""
        momentum = angular_momentum_about_centre(run)
        axis = run.system.unknowns.state.vectors([self.frame.directors[2]])[0]
        # The angle from its sine and its cosine: the cosine alone has no digits of small ones.
        across = float(np.linalg.norm(np.cross(axis, momentum)))
        return math.atan2(across, float(axis @ momentum))


def angular_momentum_about_centre(run: StateView) -> Array:
    """Angular momentum (3,) [kg m²/s] of all bodies and reaction wheels about their centre of
    mass."""
    system = run.system
    momenta = system.unknowns.v0.duplicate()
    system.unknowns.M.mult(system.unknowns.v0, momenta)
    is_position = system.unknowns.position_marks  # (n,), 1 for positions and 0 for directors
    size = 3 * len(is_position)  # without multipliers
    # p: momenta [kg m/s], q: coordinates [m] of this rank's vectors (n, 3): positions and
    # directors.
    p = momenta.array_r[:size].reshape(-1, 3)
    q = system.unknowns.q0.array_r[:size].reshape(-1, 3)
    # Directors have angular momentum, but no momentum.
    own = np.concatenate([is_position @ p, np.cross(q, p).sum(axis=0)])
    for loads in system.equations.compiled_as(PointLoads):
        own[3:] += loads.wheel_momentum()
    momenta.destroy()
    sums = run.comm.allreduce(own)
    return sums[3:] - np.cross(centre_of_mass(system), sums[:3])


def centre_of_mass(system: System) -> Array:
    """Centre of mass (3,) [m] of all bodies of a scene; NaN for a scene without mass."""
    is_position = system.unknowns.position_marks  # (n,), 1 for positions and 0 for directors
    size = 3 * len(is_position)
    translation = system.unknowns.q0.duplicate()
    weight = system.unknowns.q0.duplicate()
    masses = np.zeros(3)
    first_moments = np.zeros(3)
    for axis in range(3):
        translation.set(0.0)
        with translation as entries:
            # A translation moves positions, not directors and multipliers.
            entries[:size].reshape(-1, 3)[:, axis] = is_position
        system.unknowns.M.mult(translation, weight)
        masses[axis] = weight.dot(translation)
        first_moments[axis] = weight.dot(system.unknowns.q0)
    translation.destroy()
    weight.destroy()
    return first_moments / masses


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

    def __init__(self, body: Body, axis: AxisName = "z") -> None:
        self.body = body
        self.axis: AxisName = axis

    def __call__(self, run: StateView) -> float:
        """The mean spin [rad/s] in the state of a run; 0 for a body without moment of inertia.
        Collective.

        Raises:
            InputError: the body is not in the scene.
        """
        system = run.system
        state = system.unknowns.state[self.body]
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
        owned = system.unknowns.state[self.body].owned
        alone = system.unknowns.q0.duplicate()
        product = system.unknowns.q0.duplicate()
        alone.set(0.0)
        with alone as entries:
            entries[owned].reshape(-1, 3)[:, plane] = values
        system.unknowns.M.mult(alone, product)
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

    def __init__(
        self, port: Port, frame: FullFrame, *, quantity: Literal["radius", "angle"] = "radius"
    ) -> None:
        self.port = port
        self.frame = frame
        self.quantity = quantity

    def __call__(self, run: StateView) -> float:
        """The radius [m], or the angle [rad] in -π to π, in the state of a run.  Collective.

        Raises:
            InputError: the body of the point or of the frame is not in the scene.
        """
        ports = [self.port, self.frame.origin, *self.frame.directors]
        point, origin, first_axis, second_axis, _ = run.system.unknowns.state.vectors(ports)
        arm = point - origin
        along_first = float(arm @ first_axis)
        along_second = float(arm @ second_axis)
        if self.quantity == "radius":
            return math.hypot(along_first, along_second)
        return math.atan2(along_second, along_first)


@check_arguments
class Waves:
    """Fourier coefficient [m] of the heights or radii of points around the third axis of a frame.

    With the values w_k of N points, numbered around the axis in the sense of positive rotation from
    the first one, and n waves around the axis,

        a_n = 2/N Σ w_k cos(2π n k/N),    b_n = 2/N Σ w_k sin(2π n k/N)

    with 1/N in place of 2/N for n = 0 and n = N/2.  A wave A cos(n θ - ω t) that runs forward, in
    the sense of positive rotation, has a_n = A cos ω t and b_n = A sin ω t; see
    `gx.analysis.travelling_waves`.  The points move with their bodies: ω is the frequency that is
    seen from a sail that spins.

    Args:
        ports: points of bodies, at even angles around the axis and in their order; at least 3.
        frame: with three directors, e.g. of the hub.
        number: n, the waves around the axis, 0 to N/2.
        part: "cosine" for a_n or "sine" for b_n.
        quantity: "height" along the third axis of the frame, from its origin, or "radius" from this
            axis.

    Raises:
        InputError: fewer than 3 points, more waves than these can show, an unknown part or
            quantity, or a frame with two directors only.

    Example:
        >>> corners = ("bottom left", "bottom right", "top right", "top left")
        >>> tips = [film.port(corner) for corner in corners]
        >>> saddle = gx.probes.Waves(tips, gx.ground_frame(), number=2)
    """

    unit = "m"

    def __init__(
        self,
        ports: Annotated[Sequence[Port], at_least(3)],
        frame: FullFrame,
        *,
        number: int,
        part: Literal["cosine", "sine"] = "cosine",
        quantity: Literal["height", "radius"] = "height",
    ) -> None:
        count = len(ports)
        check(
            0 <= number <= count // 2,
            f"Waves: {count} points cannot show {number} waves; give 0 to {count // 2}, or more "
            "points.",
        )
        self.ports = tuple(ports)
        self.frame = frame
        self.quantity = quantity
        phase = 2 * np.pi * number * np.arange(count) / count
        pattern = np.cos(phase) if part == "cosine" else np.sin(phase)
        # The mean square of a cosine is 1/2, but 1 where it is a constant or alternates.
        is_extreme = 2 * number in (0, count)
        self._weights = pattern * (1 if is_extreme else 2) / count

    def __call__(self, run: StateView) -> float:
        """The coefficient [m] in the state of a run."""
        heights, radii = cylindrical(run, self.ports, self.frame)
        values = heights if self.quantity == "height" else radii
        return float(self._weights @ values)


@check_arguments
class Imbalance:
    """Largest less smallest radius of some points about the third axis of a frame, over their mean.

    Args:
        ports: points of bodies, e.g. the tips of the arms of a sail; at least 2.
        frame: with three directors, e.g. of the hub.

    Raises:
        InputError: fewer than 2 points, or a frame with two directors only.

    Example:
        >>> tips = [film.port("bottom left"), film.port("top right")]
        >>> imbalance = gx.probes.Imbalance(tips, gx.ground_frame())
    """

    unit = "1"

    def __init__(self, ports: Annotated[Sequence[Port], at_least(2)], frame: FullFrame) -> None:
        self.ports = tuple(ports)
        self.frame = frame

    def __call__(self, run: StateView) -> float:
        """The imbalance in the state of a run; 0 where all points are on the axis."""
        _, radii = cylindrical(run, self.ports, self.frame)
        mean = radii.mean()
        if mean == 0:
            return 0.0
        return float((radii.max() - radii.min()) / mean)


def cylindrical(run: StateView, ports: Sequence[Port], frame: Frame) -> tuple[Array, Array]:
    """Heights and radii (n,) [m] of points in a frame, on every rank.  Collective."""
    vectors = run.system.unknowns.state.vectors([*ports, frame.origin, *frame.directors])
    points = np.array(vectors[: len(ports)])
    origin, *axes = vectors[len(ports) :]
    components = (points - origin) @ np.array(axes).T
    return components[:, 2], np.hypot(components[:, 0], components[:, 1])
