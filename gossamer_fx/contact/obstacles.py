"""Solids that films, cables and beams touch: fixed, moved, or parts of rigid bodies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np

from gossamer_fx.algebra.rotations import perpendicular_pair
from gossamer_fx.bodies.frames import along, ground_frame
from gossamer_fx.bodies.rigid_body import RigidBody
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check, is_vector
from gossamer_fx.contact.potential import IN_CYLINDER, IN_SPHERE, PLANE
from gossamer_fx.model.body import Array, Attached, Ground, Port, Vector

PrescribedMotion = Callable[[float], Sequence[float]]


@dataclass(frozen=True)
class ObstacleWall:
    """A wall that points of films are kept off: `kind` of its pairs, what stands behind the point in them, and size.

    behind: three vectors: origin, and normal or two directions across the axis.  radius [m] of balls and cylinders.
    """

    kind: int
    behind: tuple[Attached, Attached, Attached]
    radius: float = 0.0


@dataclass(frozen=True)
class ObstacleSolid:
    """Corners, edges (e, 2) and triangles (t, 3) between them, with a radius [m] around all of them."""

    corners: tuple[Attached, ...]
    edges: tuple[tuple[int, int], ...] = ()
    triangles: tuple[tuple[int, int, int], ...] = ()
    radius: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Obstacle:
    """Something solid.  Points and directions are those of the start, in space.

    body: the rigid body of which it is a part; none: it stays, or moves as prescribed.
    motion: displacement [m] of the obstacle as a function of time [s]; its work is booked as supplied.
    friction: coefficient of Coulomb friction with it; none: that of the contact.
    """

    body: RigidBody | None = None
    motion: PrescribedMotion | None = None
    friction: float | None = None
    name: str = "obstacle"

    def __post_init__(self) -> None:
        check_friction(
            f"{type(self).__name__} '{self.name}'", 0.0 if self.friction is None else self.friction
        )
        check(
            self.body is None or self.motion is None,
            f"{type(self).__name__} '{self.name}': a part of a rigid body has no motion of its own; leave out one of "
            "'on' and 'motion'.",
        )
        for what in ("point", "normal", "centre", "start", "end", "sizes"):
            value = getattr(self, what, (0.0, 0.0, 0.0))
            check(
                is_vector(value),
                f"{type(self).__name__} '{self.name}': {what} is {value!r}; give three finite numbers.",
            )
        radius = getattr(self, "radius", 1.0)
        check(
            math.isfinite(radius) and radius > 0,
            f"{type(self).__name__} '{self.name}': radius is {radius!r} m; give a positive number.",
        )

    def parts(self) -> tuple[list[ObstacleWall], list[ObstacleSolid]]:
        """Walls and solids that make it up."""
        raise NotImplementedError

    def requires(self) -> Iterable[Any]:
        return () if self.body is None else (self.body,)

    def frame(self) -> tuple[Attached, ...]:
        """An origin and three axes that move with it."""
        if self.body is None:
            frame = ground_frame()
            return frame.origin, *frame.directors
        return Port(self.body, (0,)), *self.body.frame().directors

    def _at(self, place: Array | Vector) -> Attached:
        x, y, z = np.asarray(place, dtype=float)
        return (
            Ground((float(x), float(y), float(z)))
            if self.body is None
            else self.body.port_at((x, y, z))
        )

    def _along(self, direction: Array) -> Attached:
        """A direction that turns with the obstacle."""
        if self.body is None:
            x, y, z = direction
            return Ground((float(x), float(y), float(z)))
        return along(direction, self.body.frame())


def check_friction(owner: str, friction: float) -> None:
    """Raise `InputError` for what is no coefficient of friction."""
    check(
        math.isfinite(friction) and friction >= 0,
        f"{owner}: friction is {friction!r}; give zero, or a positive ratio of forces.",
    )


def _unit(vector: Vector | Array, what: str) -> Array:
    n = np.asarray(vector, dtype=float)
    length = np.linalg.norm(n)
    check(bool(length > 0), f"{what} has no length; give a direction.")
    unit: Array = n / length
    return unit


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Plane(Obstacle):
    """The half-space behind a plane.

    Args:
        point: on the plane [m].
        normal: towards the side where films are.
    """

    point: Vector
    normal: Vector

    def parts(self) -> tuple[list[ObstacleWall], list[ObstacleSolid]]:
        n = _unit(self.normal, f"Plane '{self.name}': its normal")
        origin = self._at(self.point)
        return [ObstacleWall(PLANE, (origin, self._along(n), origin))], []


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Sphere(Obstacle):
    """A ball, or the room within it.

    Args:
        centre: [m].
        radius: [m].
        inside: whether films are kept within it.
    """

    centre: Vector
    radius: float
    inside: bool = False

    def parts(self) -> tuple[list[ObstacleWall], list[ObstacleSolid]]:
        c = self._at(self.centre)
        return (
            ([ObstacleWall(IN_SPHERE, (c, c, c), self.radius)], [])
            if self.inside
            else ([], [ObstacleSolid((c,), radius=self.radius)])
        )


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Cylinder(Obstacle):
    """A cylinder with half a ball at each end, or the room within an endless one.

    Args:
        start, end: of its axis [m].
        radius: [m].
        inside: whether films are kept within it.
    """

    start: Vector
    end: Vector
    radius: float
    inside: bool = False

    def parts(self) -> tuple[list[ObstacleWall], list[ObstacleSolid]]:
        axis = _unit(np.subtract(self.end, self.start), f"Cylinder '{self.name}': its axis")
        a, b = self._at(self.start), self._at(self.end)
        if not self.inside:
            return [], [ObstacleSolid((a, b), ((0, 1),), radius=self.radius)]
        u, v = perpendicular_pair(axis)
        return [ObstacleWall(IN_CYLINDER, (a, self._along(u), self._along(v)), self.radius)], []


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Box(Obstacle):
    """A box, or the room within it.

    Args:
        centre: [m].
        sizes: lengths of its edges [m].
        axes: directions of its edges, rows (3, 3); default those of space.
        inside: whether films are kept within it.
    """

    centre: Vector
    sizes: Vector
    axes: Sequence[Vector] = field(default=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    inside: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check(
            min(self.sizes) > 0,
            f"Box '{self.name}': sizes are {tuple(self.sizes)!r} m; give positive numbers.",
        )
        A = np.asarray(self.axes, dtype=float)
        check(
            A.shape == (3, 3) and bool(np.allclose(A @ A.T, np.eye(3), atol=1e-9)),
            f"Box '{self.name}': its axes are no three orthonormal directions; give them as rows.",
        )

    def parts(self) -> tuple[list[ObstacleWall], list[ObstacleSolid]]:
        A, c, half = (
            np.asarray(self.axes, float),
            np.asarray(self.centre, float),
            np.asarray(self.sizes, float) / 2,
        )
        if self.inside:
            walls = []
            for axis, h in zip(A, half, strict=True):
                for sign in (-1, 1):
                    origin = self._at(c + sign * h * axis)
                    walls.append(ObstacleWall(PLANE, (origin, self._along(-sign * axis), origin)))
            return walls, []
        corners = [
            c + (np.array(s) * half) @ A for s in product((-1, 1), repeat=3)
        ]  # number: bits of the signs
        edges = [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]
        triangles = []
        for bit in (1, 2, 4):
            a, b = (other for other in (1, 2, 4) if other != bit)
            for base in (0, bit):
                triangles += [(base, base | a, base | a | b), (base, base | b, base | a | b)]
        return [], [
            ObstacleSolid(tuple(self._at(p) for p in corners), tuple(edges), tuple(triangles))
        ]
