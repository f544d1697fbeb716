"""Guides that roll round a hub and let wound arms out, as those of IKAROS."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Annotated, Any

import gossamer_fx as gx
from gossamer_fx.extend import Group, Range, check, check_arguments, positive

# Stiffness [N/m] of the tether of the reel.
REEL = 1e4
# Largest number of rods: each is a rigid body with joints, a reel and a tether.
MAX_RODS = 1000

Joint = gx.constraints.RevoluteJoint | gx.constraints.CylindricalJoint
Length = Annotated[float, positive("m")]

# Against oscillations of the ring on the stiff tether.
SLOWS = 0.1  # s in which the damper takes the ring's speed along the axis


@check_arguments
class RotationGuides(Group):
    """Upright rods on a ring that turns about the z axis of a hub against a brake.

    Each arm of a sail is wound on the hub up to its rod, and stands out from there.  Its pull turns
    the ring, and as far as the ring turns, arms are unwound.  The brake has the moment c (ω_ring -
    ω_hub), whose work is dissipated.  Nothing else acts between ring and hub about the axis, so
    that the angular momentum of the whole is conserved.  To release the arms, a reel on the axis
    draws ring and rods down along the hub, against a damper.

    Args:
        hub: a rigid body whose axes are those of space at the start.
        count: number of rods, evenly spaced.
        radius: of the circle of their axes [m].
        rod_radius: radius of a rod [m].
        height: of the rods [m].
        mass: of the ring with its rods [kg], on that circle.
        brake_damping: c [N m s/rad].
        first_angle: angle of the first rod from the x axis [rad].
        drawn: displacement of the ring by the reel [m], a function of time [s] that is zero at the
            start; None: the height of the ring is constant.
        reel_depth: of the reel below the ring [m]; `drawn` stays below it.
        name: for messages and outputs; the items have names that begin with it.

    Attributes:
        ring: the body that turns.
        joint, brake: between ring and hub.
        reel: a `Tether` and a `Damper`, or nothing.
        rods: obstacles, for a `Contact`.
        rod_positions: (x, y) [m] of the axis of each rod at the start.

    Raises:
        InputError: a number is not positive, the rods reach into the axis of the hub, or `drawn` is
            not a function.

    Example:
        >>> guides = RotationGuides(hub, 4, radius=0.8, mass=2.0)
        >>> len(guides.rods)
        4
    """

    def __init__(
        self,
        hub: gx.RigidBody,
        count: Annotated[int, Range(1, MAX_RODS)],
        *,
        radius: Length,
        rod_radius: Length = 0.02,
        height: Length = 0.5,
        mass: Annotated[float, positive("kg")] = 1.0,
        brake_damping: Annotated[float, positive("N m s/rad")] = 1.0,
        first_angle: float = 0.0,
        drawn: Callable[[float], float] | None = None,
        reel_depth: Length = 1.2,
        name: str = "guides",
    ) -> None:
        self.name = name
        check(
            rod_radius < radius,
            f"RotationGuides '{name}': "
            f"rods of {rod_radius:g} m are too thick for a circle of {radius:g} m; give less.",
        )
        self.hub = hub
        self._height = height
        self._rod_radius = rod_radius
        # A thin ring: its whole mass is at the radius.  Half of the polar moment is that about a
        # diameter.
        polar = mass * radius**2
        self.ring = gx.RigidBody(
            mass, (polar / 2, polar / 2, polar), comm=hub.comm, name=f"{name} ring"
        )
        angles = [first_angle + 2 * math.pi * k / count for k in range(count)]
        self.rod_positions = [
            (radius * math.cos(angle), radius * math.sin(angle)) for angle in angles
        ]
        axis = (0.0, 0.0, 1.0)
        self.reel: tuple[gx.connectors.Tether, gx.connectors.Damper] | tuple[()] = ()
        if drawn is None:
            self.joint: Joint = gx.constraints.RevoluteJoint(
                hub.frame(), self.ring.frame(), axis=axis, name=f"{name} joint"
            )
        else:
            # Free along the axis, too, where the reel moves the ring.
            self.joint = gx.constraints.CylindricalJoint(
                hub.frame(), self.ring.frame(), axis=axis, name=f"{name} joint"
            )
            # From a point of the hub below the ring, so that a shorter tether draws the ring
            # down.
            ends = hub.port((0.0, 0.0, -reel_depth)), self.ring.port()
            reel = gx.connectors.Tether(
                *ends, stiffness=REEL, length=lambda t: reel_depth - drawn(t), name=f"{name} reel"
            )
            self.reel = (
                reel,
                gx.connectors.Damper(*ends, damping=mass / SLOWS, name=f"{name} slide"),
            )
        self.brake = gx.connectors.TorsionDamper(
            hub.frame(), self.ring.frame(), axis=axis, damping=brake_damping, name=f"{name} brake"
        )

    @property
    def rods(self) -> tuple[gx.contact.Cylinder, ...]:
        """The rods as new cylinders that move with the ring, obstacles for a `Contact`."""
        half = self._height / 2
        return tuple(
            gx.contact.Cylinder(
                start=(x, y, -half),
                end=(x, y, half),
                radius=self._rod_radius,
                body=self.ring,
                name=f"{self.name} rod {k}",
            )
            for k, (x, y) in enumerate(self.rod_positions)
        )

    def requires(self) -> Iterable[Any]:
        yield from (self.hub, self.ring, self.joint, self.brake, *self.reel)
