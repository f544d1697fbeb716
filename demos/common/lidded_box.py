"""Boxes with a lid that springs open: what folded films are stowed in."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np
from scipy.spatial.transform import Rotation

import gossamer_fx as gx
from gossamer_fx.extend import (
    Array,
    Attached,
    Group,
    check,
    check_arguments,
    not_negative,
    positive,
)

Vector = tuple[float, float, float]


@check_arguments
class LiddedBox(Group):
    """A box that is open at the top, +z, with a lid on a hinge, which a latch holds shut until it
    is released.

    The hinge is along y at the edge -x of the opening.  A spring turns the lid about it; without
    other forces by φ(t) = φr (1 - cos ωt), ω² = k/I with the lid's moment of inertia I about the
    hinge.  The stop is a cord from rim to lid, which is tight at the largest angle.  The latch
    bears the spring's moment, and does no work.  The box is fixed in space, or a part of a rigid
    body: then hinge, spring, stop and latch act between this body and the lid, so that momentum and
    angular momentum of both stay as they are.  The moment of the latch has a constant direction in
    space: the body must not turn noticeably before the release.

    Args:
        sizes: inner lengths along x, y, z [m].
        centre: of the inner space [m].
        wall_thickness: of walls and lid [m].
        mass: of the lid [kg], evenly distributed.
        stiffness: k of the spring [N m/rad].
        rest_angle: φr, angle of the lid at which the spring is relaxed [rad].
        release_time: of the latch [s].
        damping: of the hinge [N m s/rad].
        max_angle: angle at the stop [rad]; None: no stop.
        stop_stiffness: of the stop's cord [N/m].
        body: the rigid body that carries the box; None: the box is fixed in space.  The mass of the
            walls counts as that of the body, the lid's is added.
        turn: rotation vector [rad] of the box about its centre; x, y, z above are the axes of the
            turned box.
        name: for messages and outputs; the items have names that begin with it.

    Attributes:
        lid: the body that moves.
        hinge, spring, damper, latch, stop: the items between lid and space or body; None if not
            asked for.
        latch_reaction: the opposite moment on the body that carries the box; None for a box fixed
            in space.
        obstacles: walls and lid, for a `Contact`.

    Raises:
        InputError: a size, mass or stiffness is not positive, or an angle is not between 0 and π.

    Example:
        >>> box = LiddedBox((0.2, 0.1, 0.1), mass=0.05, release_time=0.1)
        >>> box.lid.name
        'box lid'
    """

    def __init__(
        self,
        sizes: Vector,
        centre: Vector = (0.0, 0.0, 0.0),
        *,
        wall_thickness: Annotated[float, positive("m")] = 2e-3,
        mass: Annotated[float, positive("kg")] = 0.1,
        stiffness: Annotated[float, positive("N m/rad")] = 0.1,
        rest_angle: float = 2.5,
        release_time: Annotated[float, not_negative("s")] = 0.0,
        damping: Annotated[float, not_negative("N m s/rad")] = 0.0,
        max_angle: float | None = 2.0,
        stop_stiffness: float = 1e4,
        body: gx.RigidBody | None = None,
        turn: Vector = (0.0, 0.0, 0.0),
        name: str = "box",
    ) -> None:
        self.name = name
        self._wall = wall_thickness
        self._half: Array = np.asarray(sizes, dtype=float) / 2
        self._centre: Array = np.asarray(centre, dtype=float)
        self._body = body
        check(
            bool((self._half > 0).all()),
            f"LiddedBox '{name}': sizes are {sizes!r} m; give three positive numbers.",
        )
        # Columns are the axes of the box in space.
        self._axes: Array = Rotation.from_rotvec(np.asarray(turn, dtype=float)).as_matrix()
        for what, angle in (
            ("rest_angle", rest_angle),
            ("max_angle", rest_angle if max_angle is None else max_angle),
        ):
            check(
                0 < angle < math.pi,
                f"LiddedBox '{name}': {what} is {angle!r} rad; give an angle between 0 and π.",
            )
        x, y, _ = 2 * self._half
        # Of a cuboid about its centre [kg m²].
        inertia = (
            mass / 12 * np.array([y**2 + wall_thickness**2, x**2 + wall_thickness**2, x**2 + y**2])
        )
        half_height = float(self._half[2]) + wall_thickness / 2
        self.lid = self._lid(mass, inertia, (0.0, 0.0, half_height))
        # The hinge is at the edge -x of the opening.
        edge = self._at((-float(self._half[0]), 0.0, half_height))
        carrier = gx.ground_frame(edge)
        if body is not None:
            carrier = body.frame_at(edge)
        sides: tuple[gx.Frame, gx.Frame] = (carrier, self.lid.frame_at(edge))
        # About -y positive angles open the lid.
        opening_axis = self._axes @ np.array([0.0, -1.0, 0.0])
        axis: Vector = (float(opening_axis[0]), float(opening_axis[1]), float(opening_axis[2]))
        self.hinge = gx.constraints.RevoluteJoint(*sides, axis=axis, name=f"{name} hinge")
        self.spring = gx.connectors.TorsionSpring(
            *sides, axis=axis, stiffness=stiffness, rest_angle=rest_angle, name=f"{name} spring"
        )
        self.damper: gx.connectors.TorsionDamper | None = None
        if damping:
            self.damper = gx.connectors.TorsionDamper(
                *sides, axis=axis, damping=damping, name=f"{name} damper"
            )
        # Moment [N m] of the spring while the box is closed, which the latch balances.
        moment = stiffness * rest_angle

        def latched(t: float) -> tuple[float, float, float]:
            """Moment (3,) [N m] of the latch on the lid at a time [s]."""
            if t >= release_time:
                return (0.0, 0.0, 0.0)
            return (-moment * axis[0], -moment * axis[1], -moment * axis[2])

        def reaction(t: float) -> tuple[float, float, float]:
            """Moment (3,) [N m] of the latch on the body that carries the box, at a time [s]."""
            mx, my, mz = latched(t)
            return (-mx, -my, -mz)

        self.latch = gx.loads.Torque(self.lid.frame(), latched, name=f"{name} latch")
        # Without it the latch would turn a free body as an external moment.
        self.latch_reaction: gx.loads.Torque | None = None
        if body is not None:
            self.latch_reaction = gx.loads.Torque(
                body.frame(), reaction, name=f"{name} latch reaction"
            )
        # A cord from rim to lid is as long as the chord of the largest angle.
        self.stop: gx.connectors.Rope | None = None
        if max_angle is not None:
            chord = 2 * x * math.sin(max_angle / 2)
            self.stop = self._cord(half_height, chord, stop_stiffness)

    def _at(self, local: Vector) -> tuple[float, float, float]:
        """Point of space [m] from coordinates of the box about its centre [m]."""
        x, y, z = self._centre + self._axes @ np.asarray(local, dtype=float)
        return float(x), float(y), float(z)

    def _lid(self, mass: float, inertia: Array, local: Vector) -> gx.RigidBody:
        """Make the lid of a mass [kg], with principal moments of inertia (3,) [kg m²] about the
        axes of the box and its centre `local` (3,) [m] in these axes, as a rigid body that moves as
        the carrying body does at the start.  Collective with a carrying body."""
        position = self._at(local)
        given: dict[str, Any] = {}
        if self._body is not None:
            # Rank 0 owns the body; the lid is made alike on all ranks.
            position_vector, rate_vector = self._body.comm.bcast(self._body.initial_state())
            state = position_vector.reshape(4, 3)
            rates = rate_vector.reshape(4, 3)
            offset = np.asarray(position) - state[0]
            # Components along the directors stay; so the point has the rates of the directors.
            components = state[1:] @ offset
            velocity = rates[0] + components @ rates[1:]
            # ω = ½ Σ d_i × ḋ_i of orthonormal directors.
            spin = np.cross(state[1:], rates[1:]).sum(axis=0) / 2
            given = {"velocity": tuple(velocity), "spin": tuple(spin), "comm": self._body.comm}
        ix, iy, iz = inertia
        return gx.RigidBody(
            mass,
            (float(ix), float(iy), float(iz)),
            position=position,
            attitude=self._axes,
            name=f"{self.name} lid",
            **given,
        )

    def _cord(self, half_height: float, length: float, stiffness: float) -> gx.connectors.Rope:
        """Make the stop: a rope from the rim opposite of the hinge to the end of the lid, tight at
        a length [m], of a stiffness [N/m].  The lid's middle plane is `half_height` [m] above the
        centre of the box."""
        end = self._at((float(self._half[0]), 0.0, half_height))
        rim: Attached = gx.Ground(end)
        if self._body is not None:
            rim = self._body.port_at(end)
        return gx.connectors.Rope(
            self.lid.port_at(end),
            rim,
            length=length,
            stiffness=stiffness,
            name=f"{self.name} stop",
        )

    @property
    def obstacles(self) -> tuple[gx.contact.Box, ...]:
        """New obstacles for a `Contact`: four walls and the floor, which stand still or move with
        the body that carries the box, then the lid, which is a `Box` on its body."""
        t = self._wall
        half = self._half
        x_axis, y_axis, z_axis = (tuple(map(float, axis)) for axis in self._axes.T)
        axes = (x_axis, y_axis, z_axis)
        slabs: list[gx.contact.Box] = []
        # Four walls and the floor, by axis and side; there is none at the top.
        for axis, sign in ((0, -1), (0, 1), (1, -1), (1, 1), (2, -1)):
            local = np.zeros(3)
            local[axis] = sign * (half[axis] + t / 2)
            # Longer by the thickness at both ends along x and y, so that the corners are closed.
            sizes = 2 * half + 2 * t * (np.arange(3) != 2)
            sizes[axis] = t
            slabs.append(
                gx.contact.Box(
                    centre=self._at(tuple(local)),
                    sizes=tuple(sizes),
                    axes=axes,
                    body=self._body,
                    name=f"{self.name} wall {len(slabs) + 1}",
                )
            )
        # The cover is a part of the lid and moves with it.
        cover = gx.contact.Box(
            centre=self._at((0.0, 0.0, float(half[2]) + t / 2)),
            sizes=(2 * half[0], 2 * half[1], t),
            axes=axes,
            body=self.lid,
            name=f"{self.name} cover",
        )
        return (*slabs, cover)

    def requires(self) -> Iterable[Any]:
        yield from (self.lid, self.hinge, self.spring, self.latch)
        optional = (self._body, self.damper, self.stop, self.latch_reaction)
        yield from (part for part in optional if part is not None)
