"""Boxes with a lid that springs open: what folded films are stowed in."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from gossamer_fx.bodies.frames import ground_frame
from gossamer_fx.bodies.rigid_body import RigidBody
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.connectors.spring import Rope
from gossamer_fx.connectors.torsion import TorsionDamper, TorsionSpring
from gossamer_fx.constraints.joint import RevoluteJoint
from gossamer_fx.loads.force import Torque
from gossamer_fx.model.body import Array, Ground, Vector
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term

if TYPE_CHECKING:
    from gossamer_fx.contact.obstacles import Box


@check_arguments
class LiddedBox:
    """A box that is open at the top, +z, with a lid on a hinge, which a latch holds shut until it is released.

    The hinge is along y at the edge -x of the opening.  A spring turns the lid about it; without other forces
    by φ(t) = φr (1 - cos ωt), ω² = k/I with the lid's moment of inertia I about the hinge.  The stop is a cord
    from rim to lid, which is tight at the largest angle.  The latch bears the spring's moment, and does no
    work.  The box is fixed in space.

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
        name: for messages and outputs; the parts have names that begin with it.

    Attributes:
        lid: the body that moves.
        hinge, spring, damper, latch, stop: the parts between lid and space; None if not asked for.
        obstacles: walls and lid, for a `Contact`.

    Raises:
        InputError: a size, mass or stiffness is not positive, or an angle is not between 0 and π.

    Example:
        >>> box = gx.assemblies.LiddedBox((0.2, 0.1, 0.1), mass=0.05, release_time=0.1)
        >>> box.lid.name
        'box lid'
    """

    def __init__(
        self,
        sizes: Vector,
        centre: Vector = (0.0, 0.0, 0.0),
        *,
        wall_thickness: float = 2e-3,
        mass: float = 0.1,
        stiffness: float = 0.1,
        rest_angle: float = 2.5,
        release_time: float = 0.0,
        damping: float = 0.0,
        max_angle: float | None = 2.0,
        stop_stiffness: float = 1e4,
        name: str = "box",
    ) -> None:
        """Check the arguments, which the class describes, and make lid, hinge, spring, latch and
        stop.
        """
        self.name = name
        self._wall = wall_thickness
        self._half: Array = np.asarray(sizes, dtype=float) / 2
        self._centre: Array = np.asarray(centre, dtype=float)
        good = self._half.shape == (3,) and bool(
            np.isfinite(self._half).all() and (self._half > 0).all()
        )
        check(good, f"LiddedBox '{name}': sizes are {sizes!r} m; give three positive numbers.")
        good = self._centre.shape == (3,) and bool(np.isfinite(self._centre).all())
        check(good, f"LiddedBox '{name}': centre is {centre!r} m; give three finite numbers.")
        for what, value, unit in (
            ("wall_thickness", wall_thickness, "m"),
            ("mass", mass, "kg"),
            ("stiffness", stiffness, "N m/rad"),
        ):
            check(
                math.isfinite(value) and value > 0,
                f"LiddedBox '{name}': {what} is {value!r} {unit}; give a positive number.",
            )
        for what, angle in (
            ("rest_angle", rest_angle),
            ("max_angle", rest_angle if max_angle is None else max_angle),
        ):
            check(
                0 < angle < math.pi,
                f"LiddedBox '{name}': {what} is {angle!r} rad; give an angle between 0 and π.",
            )
        check(
            math.isfinite(release_time) and release_time >= 0,
            f"LiddedBox '{name}': release_time is {release_time!r} s; give zero or a later time.",
        )
        check(
            math.isfinite(damping) and damping >= 0,
            f"LiddedBox '{name}': damping is {damping!r} N m s/rad; give zero or a positive number.",
        )
        x, y, _ = 2 * self._half
        top = self._centre + np.array([0.0, 0.0, self._half[2] + wall_thickness / 2])
        # Of a cuboid about its centre [kg m²].
        inertia = (
            mass / 12 * np.array([y**2 + wall_thickness**2, x**2 + wall_thickness**2, x**2 + y**2])
        )
        self.lid = RigidBody(
            mass,
            (float(inertia[0]), float(inertia[1]), float(inertia[2])),
            position=(float(top[0]), float(top[1]), float(top[2])),
            name=f"{name} lid",
        )
        # The hinge is at the edge -x of the opening.
        edge = (float(top[0] - self._half[0]), float(top[1]), float(top[2]))
        sides = ground_frame(edge), self.lid.frame_at(edge)
        # About -y positive angles open the lid.
        axis = (0.0, -1.0, 0.0)
        self.hinge = RevoluteJoint(*sides, axis=axis, name=f"{name} hinge")
        self.spring = TorsionSpring(
            *sides, axis=axis, stiffness=stiffness, rest_angle=rest_angle, name=f"{name} spring"
        )
        self.damper = (
            TorsionDamper(*sides, axis=axis, damping=damping, name=f"{name} damper")
            if damping
            else None
        )
        # Moment [N m] of the spring while the box is closed, which the latch balances.
        moment = stiffness * rest_angle
        self.latch = Torque(
            self.lid.frame(),
            lambda t: (0.0, moment if t < release_time else 0.0, 0.0),
            name=f"{name} latch",
        )
        # A cord from rim to lid is as long as the chord of the largest angle.
        self.stop = (
            self._cord(top, 2 * x * math.sin(max_angle / 2), stop_stiffness)
            if max_angle is not None
            else None
        )

    def _cord(self, top: Array, length: float, stiffness: float) -> Rope:
        """From the rim opposite of the hinge to the end of the lid."""
        end = top + np.array([self._half[0], 0.0, 0.0])
        rim = Ground((float(end[0]), float(end[1]), float(end[2])))
        return Rope(
            self.lid.port_at(end.tolist()),
            rim,
            length=length,
            stiffness=stiffness,
            name=f"{self.name} stop",
        )

    @property
    def obstacles(self) -> tuple[Box, ...]:
        """Four walls and the floor, which stand still, and the lid."""
        # Imported here: a box that nothing touches does not load contact.
        from gossamer_fx.contact.obstacles import Box

        t = self._wall
        half = self._half
        slabs: list[Box] = []
        # Four walls and the floor, by axis and side; there is none at the top.
        for axis, sign in ((0, -1), (0, 1), (1, -1), (1, 1), (2, -1)):
            at = self._centre.copy()
            at[axis] += sign * (half[axis] + t / 2)
            # Longer by the thickness at both ends along x and y, so that the corners are closed.
            sizes = 2 * half + 2 * t * (np.arange(3) != 2)
            sizes[axis] = t
            slabs.append(
                Box(centre=tuple(at), sizes=tuple(sizes), name=f"{self.name} wall {len(slabs) + 1}")
            )
        # The cover is a part of the lid and moves with it.
        above = self._centre + np.array([0.0, 0.0, half[2] + t / 2])
        room = (2 * half[0], 2 * half[1], t)
        return (
            *slabs,
            Box(centre=tuple(above), sizes=room, body=self.lid, name=f"{self.name} cover"),
        )

    def terms(self, start: State) -> Iterable[Term]:
        return ()  # its parts have all of them

    def requires(self) -> Iterable[Any]:
        yield from (self.lid, self.hinge, self.spring, self.latch)
        yield from (part for part in (self.damper, self.stop) if part is not None)
