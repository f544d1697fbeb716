"""Joints: constraints between points and frames of any two bodies, or of a body and the ground.

Each is a set of quadratic measures that stay zero (`PointConstraint`); the multipliers do no work.
With the vectors a and b attached to the two sides, and p, q, n directions that are fixed in one of
them,

    ball       x_a - x_b = 0
    link       ½(|x_a - x_b|² - l²) = 0
    fixed      ball, and g2·p1 = g3·p1 = g2·p3 = 0 for the axes p of one side that coincide with
               those of the other
    revolute   ball, and n·p = n·q = 0: the axis n of one side is normal to p, q of the other
    prismatic  the rotations of fixed, and (x_b - x_a)·p = (x_b - x_a)·q = 0
    universal  ball, and n·m = 0: an axis n of one side is normal to an axis m of the other
    cylindrical  n·p = n·q = 0 of revolute, and (x_b - x_a)·p = (x_b - x_a)·q = 0 of prismatic

A beam's section has two directors; where a joint needs its normal too, it is brought along
(`Frame.complete`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from gossamer_fx.core.algebra.point_measures import PointMeasure
from gossamer_fx.core.algebra.rotations import perpendicular_pair
from gossamer_fx.core.checks.arguments import Direction, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Attached, Port, Vector, unit
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import MeasuresStart, Term
from gossamer_fx.mechanics.bodies.frames import (
    SAME_DIRECTION,
    Between,
    Frame,
    FrameJoint,
    along,
    is_normal,
    lies_in,
)
from gossamer_fx.mechanics.terms.point_constraints import PointConstraint

# Distance up to which two points coincide, over the extent of the scene: mesh files keep this many
# digits, and nobody would model a smaller gap.
COINCIDE = 1e-8


def product(name: str, u: Attached, v: Attached) -> PointConstraint:
    """The constraint u·v = 0 of two vectors u and v (3,), each of a body or of the ground."""
    # ½ (u, v)·H (u, v) = u·v
    H = np.kron(np.array([[0.0, 1.0], [1.0, 0.0]]), np.eye(3))
    # A measure is owned by the rank of its first port, and a vector of the ground has none.
    vectors = (u, v) if isinstance(u, Port) else (v, u)
    measure = PointMeasure([vectors], H[None], np.zeros((1, 6)), np.zeros(1))
    return PointConstraint(name, measure)


def coincidence(name: str, *pairs: tuple[Attached, Attached]) -> PointConstraint:
    """x_a - x_b = 0 at each of the pairs of points (a, b)."""
    difference = np.hstack([np.eye(3), -np.eye(3)])
    measure = PointMeasure(pairs, np.zeros((3, 6, 6)), difference, np.zeros(3))
    return PointConstraint(name, measure)


def one_point(name: str, a: Attached, b: Attached, start: State) -> PointConstraint:
    """The constraint that the two points of a joint coincide, as they have to at the start, within
    `COINCIDE` of the extent of the scene: `InputError`.  Collective."""
    distance = float(np.linalg.norm(start.vector(a) - start.vector(b)))
    check(
        distance <= COINCIDE * start.extent(),
        f"Joint '{name}': its two points are {distance:.6g} m apart at the start; "
        "let them coincide, of a rigid body e.g. by port_at(point) or frame_at(point).",
    )
    return coincidence(name, (a, b))


def same_rotation(name: str, a: Frame, b: Frame, start: State) -> Iterable[PointConstraint]:
    """Constrain the relative rotation of two frames to that of the start, by three equations: each
    holds the product of a vector of one frame and a vector of the other at zero.  One of the frames
    has three orthonormal directors, the other two or three."""
    full, other = (a, b) if len(a.directors) == 3 else (b, a)
    # g2, g3 are directors of the other frame; e2, e3 their values (3,) at the start; p1, p3 vectors
    # of the full frame that are e2 × e3 and e3 at the start.
    # Two directors of the other frame are enough: three products of orthogonal vectors fix three
    # angles.  A third director would repeat what its rigidity already says, and make the
    # constraints dependent.
    g2, g3 = other.directors[-2:]
    e2, e3 = start.vectors([g2, g3])
    p1 = along(np.cross(e2, e3), full, start.vector)
    p3 = along(e3, full, start.vector)
    yield product(f"{name} rotation 3", g2, p1)
    yield product(f"{name} rotation 2", g3, p1)
    yield product(f"{name} rotation 1", g2, p3)


def axis_at(axis: Vector, sides: tuple[Frame, Frame], start: State) -> Array:
    """The axis (3,) of two frames at the start of a scene: fixed in one with three directors, of
    two in the ground, and else in a body that may have turned since it was made.  Collective."""
    carrier = min(sides, key=lambda side: (len(side.directors) < 3, isinstance(side.origin, Port)))
    return start.vector(along(unit(axis), carrier))


def same_axis(
    name: str, n: Array, full: Frame, other: Frame, start: State
) -> Iterable[PointConstraint]:
    """Constrain a direction n, a unit vector (3,) at the start, to be the same in two frames, by
    two equations.  One frame has three directors; those of the other contain n or are all normal to
    it."""
    # The axis is a vector of one frame, and two of the other (p, q) stay normal to it.  A beam's
    # section has no vector along its normal, but two across it.
    if is_normal(n, other, start.vector):
        fixed = along(n, full, start.vector)
        p, q = other.directors
    else:
        fixed = along(n, other, start.vector)
        p, q = (along(e, full, start.vector) for e in perpendicular_pair(n))
    yield product(f"{name} tilt 1", fixed, p)
    yield product(f"{name} tilt 2", fixed, q)


def on_axis(
    kind: str, name: str, n: Array, a: Frame, b: Frame, start: State
) -> Iterable[PointConstraint]:
    """Constrain the origin of b to the straight line through the origin of a of direction n at the
    start, which turns with a: two equations (x_b - x_a)·p = 0 for vectors p of a that are normal to
    n.  `kind` is the class of the joint, for messages.  Collective."""
    gap = start.vector(b.origin) - start.vector(a.origin)
    check(
        float(np.linalg.norm(np.cross(gap, n))) <= COINCIDE * start.extent(),
        f"{kind} '{name}': its second point is off the axis through the first; place both on it.",
    )
    for k, e in enumerate(perpendicular_pair(n)):
        measure = offset(a.origin, b.origin, along(e, a, start.vector))
        yield PointConstraint(f"{name} slide {k + 1}", measure)


def offset(a: Attached, b: Attached, p: Attached) -> PointMeasure:
    """The measure (x_b - x_a)·p [m] of two points and a direction."""
    # ½ z·H z = (x_b - x_a)·p for the stacked vectors z = (x_a, x_b, p).
    H = np.zeros((3, 3))
    H[0, 2] = H[2, 0] = -1.0
    H[1, 2] = H[2, 1] = 1.0
    return PointMeasure([(a, b, p)], np.kron(H, np.eye(3))[None], np.zeros((1, 9)), np.zeros(1))


@check_arguments
@dataclass(frozen=True, eq=False)
class BallJoint(Between):
    """Two points coincide; the bodies turn freely about them.

    Args:
        a, b: ports of two bodies that are at one point at the start; one of them may be a `Ground`.
        name: name in messages and output.

    Raises:
        InputError: two points of the ground; when the scene is compiled: points that are apart.

    Example:
        >>> pivot = hub.port((0.0, 0.0, -1.0))
        >>> gx.constraints.BallJoint(pivot, mass.port()).name
        'ball'
    """

    a: Attached
    b: Attached
    _: KW_ONLY
    name: str = "ball"

    def terms(self, start: State) -> Iterable[Term]:
        yield one_point(self.name, self.a, self.b, start)


@check_arguments
@dataclass(frozen=True, eq=False)
class Link(Between, MeasuresStart):
    """A rigid rod without mass: two points keep the distance that they have at the start.

    Args:
        a, b: ports of bodies; one of them may be a `Ground`.
        name: name in messages and output.

    Raises:
        InputError: two points of the ground; when the scene is compiled: points that coincide.

    Example:
        A pendulum of 1 m has the period 2π √(L/g) = 2.006 s for small swings.

        >>> bob = gx.PointMass(1.0, (0.01, 0.0, -0.99995), comm=comm)
        >>> rod = gx.constraints.Link(bob.port(), gx.Ground((0.0, 0.0, 0.0)))
        >>> run = gx.Simulation(gx.Scene(rod, gx.Gravity(bob)), gx.Midpoint(0.01))
        >>> run.run(until=2.0061 / 2)
        >>> round(float(gx.probes.Position(bob.port(), "x")(run)), 4)
        -0.01
    """

    a: Attached
    b: Attached
    _: KW_ONLY
    name: str = "link"

    def terms(self, start: State) -> Iterable[Term]:
        """One constraint (|x_a - x_b|² - l²)/2l = 0, whose multiplier is the force of the rod [N];
        l is the initial distance.  Collective."""
        length = float(np.linalg.norm(start.vector(self.a) - start.vector(self.b)))
        check(
            length > 0,
            f"Link '{self.name}' has no length; use a BallJoint for points that coincide.",
        )
        # e = (|x_a - x_b|² - l²)/2l = ½ X·H X/l + c/l, whose gradient is a unit vector as those of
        # other joints: the multiplier is the force of the rod.
        difference = np.hstack([np.eye(3), -np.eye(3)])
        H = difference.T @ difference
        c = -(length**2) / 2
        measure = PointMeasure(
            ports=[(self.a, self.b)],
            H=H[None] / length,
            L=np.zeros((1, 6)),
            c=np.array([c / length]),
        )
        yield PointConstraint(self.name, measure)


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class FixedJoint(FrameJoint, MeasuresStart):
    """The relative position and rotation of two frames are constant: a weld.

    Args:
        a, b: frames of two bodies that have one origin at the start; one may be `ground_frame()`.
            One of them has three directors (a rigid body or the ground), or is completed to three.
        name: name in messages and output.

    Raises:
        InputError: frames of one body; when the scene is compiled: origins that are apart.

    Example:
        >>> gx.constraints.FixedJoint(beam.frame("start"), hub.frame()).name
        'fixed'
    """

    name: str = "fixed"

    @cached_property
    def _sides(self) -> tuple[Frame, Frame]:
        return self.a if len(self.b.directors) == 3 else self.a.complete, self.b

    def terms(self, start: State) -> Iterable[Term]:
        yield one_point(self.name, self.a.origin, self.b.origin, start)
        yield from same_rotation(self.name, *self._sides, start)


@dataclass(frozen=True, eq=False, kw_only=True)
class AxisJoint(FrameJoint, MeasuresStart):
    """Frames that share an axis, a direction in space at the start, and turn about it if it is that
    of a hinge."""

    is_hinge: ClassVar[bool] = False
    axis: Direction


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class RevoluteJoint(AxisJoint):
    """Two frames share a point and an axis: a hinge.

    Args:
        a, b: frames of two bodies that have one origin at the start; one may be `ground_frame()`.
        axis: direction in space at the start, of any length.
        name: name in messages and output.

    Raises:
        InputError: frames of one body, an axis of length zero; when the scene is compiled: origins
            that are apart.

    Example:
        >>> ground = gx.ground_frame()
        >>> gx.constraints.RevoluteJoint(ground, hub.frame(), axis=(0.0, 0.0, 1.0)).name
        'revolute'
    """

    is_hinge: ClassVar[bool] = True
    name: str = "revolute"

    @cached_property
    def _sides(self) -> tuple[Frame, Frame]:
        full, other = (self.a, self.b) if len(self.a.directors) == 3 else (self.b, self.a)
        n = unit(self.axis)
        # Two directors of a section span all vectors in it.  An axis that is neither in the section
        # nor normal to it needs the third, which costs three unknowns and three constraints.
        if lies_in(n, other) or is_normal(n, other):
            return full.complete, other
        return full.complete, other.complete

    def terms(self, start: State) -> Iterable[Term]:
        yield one_point(self.name, self.a.origin, self.b.origin, start)
        n = axis_at(self.axis, self._sides, start)
        yield from same_axis(self.name, n, *self._sides, start)


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class UniversalJoint(FrameJoint, MeasuresStart):
    """Two frames share a point, and an axis of each stays normal to one of the other: a cross.

    Args:
        a, b: frames of two bodies that have one origin at the start; one may be `ground_frame()`.
        axis_a, axis_b: directions in space at the start, of any length and normal to each other, of
            the arms of the cross that turn in `a` and in `b`.
        name: name in messages and output.

    Raises:
        InputError: frames of one body, axes that are not normal to each other; when the scene is
            compiled: origins that are apart.

    Example:
        >>> axes = {"axis_a": (1.0, 0.0, 0.0), "axis_b": (0.0, 1.0, 0.0)}
        >>> gx.constraints.UniversalJoint(gx.ground_frame(), hub.frame(), **axes).name
        'universal'
    """

    axis_a: Direction
    axis_b: Direction
    name: str = "universal"

    def __post_init__(self) -> None:
        super().__post_init__()
        check(
            bool(abs(unit(self.axis_a) @ unit(self.axis_b)) <= SAME_DIRECTION),
            f"UniversalJoint '{self.name}': its axes {self.axis_a} and {self.axis_b} are not "
            "normal to each other; give two directions at a right angle.",
        )

    @cached_property
    def _sides(self) -> tuple[Frame, Frame]:
        a = self.a if lies_in(unit(self.axis_a), self.a) else self.a.complete
        b = self.b if lies_in(unit(self.axis_b), self.b) else self.b.complete
        return a, b

    def terms(self, start: State) -> Iterable[Term]:
        yield one_point(self.name, self.a.origin, self.b.origin, start)
        a, b = self._sides
        # Carried by the bodies since they were made, as they may start turned.
        n = along(unit(self.axis_a), a)
        m = along(unit(self.axis_b), b)
        yield product(f"{self.name} cross", n, m)


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class PrismaticJoint(AxisJoint):
    """Two frames slide along an axis, which `a` carries, without relative rotation: a rail.

    Args:
        a, b: frames of two bodies; one may be `ground_frame()`.
        axis: direction in space at the start, of any length.
        name: name in messages and output.

    Raises:
        InputError: frames of one body, an axis of length zero; when the scene is compiled: a
            second origin that is not on the axis through the first.

    Example:
        >>> ground = gx.ground_frame()
        >>> gx.constraints.PrismaticJoint(ground, hub.frame(), axis=(0.0, 0.0, 1.0)).name
        'prismatic'
    """

    name: str = "prismatic"

    @cached_property
    def _sides(self) -> tuple[Frame, Frame]:
        # Two directors of a section across the axis are both its normals: no third one is needed.
        enough = len(self.b.directors) == 3 and is_normal(unit(self.axis), self.a)
        return self.a if enough else self.a.complete, self.b

    def terms(self, start: State) -> Iterable[Term]:
        a, b = self._sides
        yield from same_rotation(self.name, a, b, start)
        n = axis_at(self.axis, self._sides, start)
        yield from on_axis("PrismaticJoint", self.name, n, a, b, start)


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class CylindricalJoint(AxisJoint):
    """Two frames slide along an axis, which `a` carries, and turn about it.

    Args:
        a, b: frames of two bodies; one may be `ground_frame()`.
        axis: direction in space at the start, of any length.
        name: name in messages and output.

    Raises:
        InputError: frames of one body, an axis of length zero; when the scene is compiled: a
            second origin that is not on the axis through the first.

    Example:
        >>> ground = gx.ground_frame()
        >>> gx.constraints.CylindricalJoint(ground, hub.frame(), axis=(0.0, 0.0, 1.0)).name
        'cylindrical'
    """

    is_hinge: ClassVar[bool] = True
    name: str = "cylindrical"

    @cached_property
    def _sides(self) -> tuple[Frame, Frame]:
        n = unit(self.axis)
        # As of `RevoluteJoint`: a third director only for an oblique axis.
        if lies_in(n, self.b) or is_normal(n, self.b):
            return self.a.complete, self.b
        return self.a.complete, self.b.complete

    def terms(self, start: State) -> Iterable[Term]:
        n = axis_at(self.axis, self._sides, start)
        a, b = self._sides
        yield from same_axis(self.name, n, a, b, start)
        yield from on_axis("CylindricalJoint", self.name, n, a, b, start)
