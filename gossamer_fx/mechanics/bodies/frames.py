"""Frames: oriented points of bodies and of the ground, a beam's section with its normal, and what
joins two of them or acts between two points."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from operator import methodcaller
from typing import Annotated, Any

import numpy as np
from dolfinx.common import IndexMap

from gossamer_fx.core.algebra.point_measures import PointMeasure
from gossamer_fx.core.algebra.rotations import perpendicular_pair
from gossamer_fx.core.checks.arguments import Mark, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import (
    Array,
    Attached,
    Block,
    Body,
    Ground,
    Port,
    Vector,
    combine,
    unit,
)
from gossamer_fx.core.model.item import Item
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.terms.point_constraints import PointConstraint

# Components of unit vectors that differ by less are equal.  The round-off of a direction that a
# user computes is far below, an error of the direction far above.
SAME_DIRECTION = 1e-9

# Coordinates of a frame: a point and three directors.
FRAME_SIZE = 12

# The vector (3,) of a port or of the ground as the body is made, outside of any scene.
INITIAL: Callable[[Attached], Array] = methodcaller("initial")


class OneNode(Body):
    """A body with one node of one or more vectors, which rank 0 owns; all ranks know its start."""

    description: str  # in messages
    # Coordinates and rates at the start, of any shape
    _q: Array
    _v: Array

    def _make_node(self, size: int) -> None:
        """Make the block of the node, of `size` coordinates.  Collective."""
        self.block = Block(IndexMap(self.comm, int(self.comm.rank == 0)), size)

    def initial_state(self) -> tuple[Array, Array]:
        """Coordinates and rates at the start, flattened; empty on all ranks but rank 0."""
        own_size = self.block.size * self.block.index_map.size_local
        return self._q.ravel()[:own_size].copy(), self._v.ravel()[:own_size].copy()

    def describe(self, node: int) -> str:
        return self.description

    def vector(self, k: int) -> Port:
        """The vector k of the node, counted from zero, as a port."""
        return Port(self, (0,), weights=(1.0,), vectors=(k,))


@check_arguments
@dataclass(frozen=True, eq=False)
class Frame:
    """An oriented point of a body: an origin, and two or three directors that stay orthonormal.

    Rigid bodies and the ground have three (d1, d2, d3); a beam has the two of its section (d2, d3).
    Frames are made by bodies, e.g. `hub.frame()` and `beam.frame("end")`, and by `ground_frame`.

    Args:
        origin: a port, or a `Ground`.
        directors: ports or grounds that stand for directions, orthonormal.
        name: name in messages.

    Raises:
        InputError: an argument is missing or unknown, or not of the type in its annotation.

    Example:
        >>> len(hub.frame().directors), len(beam.frame("end").directors)
        (3, 2)
    """

    origin: Attached
    directors: tuple[Attached, ...]
    _: KW_ONLY
    name: str = ""

    @cached_property
    def complete(self) -> Frame:
        """This frame if it has three directors or is of the ground; of a beam's section one with
        its normal too (`SectionFrame`), made once for all that need it."""
        if len(self.directors) == 3 or isinstance(self.origin, Ground):
            return self
        return SectionFrame(self, self.origin).frame


@dataclass(frozen=True, eq=False)
class Line:
    """A point of a body and one director: a straight edge, whose rotation about itself means
    nothing."""

    origin: Attached
    directors: tuple[Attached, ...]


# Frames that turn with what they are fixed to, and those with all three axes.
TurningFrame = Annotated[
    Frame,
    Mark(
        lambda frame: len(frame.directors) >= 2,
        "the frame of a rigid body, a beam, or a patch of a film",
    ),
]
FullFrame = Annotated[
    Frame,
    Mark(
        lambda frame: len(frame.directors) == 3,
        "a frame with three directors, as that of a rigid body",
    ),
]


@check_arguments
def ground_frame(point: Vector = (0.0, 0.0, 0.0)) -> Frame:
    """The axes of inertial space at a point.

    Args:
        point: coordinates (3,) [m].

    Returns:
        The frame, with the directors x, y, z.

    Raises:
        InputError: the point is not three finite numbers, each of a size up to 1e100; or another
            argument is given.

    Example:
        >>> gx.ground_frame((0.0, 0.0, 1.0)).origin
        Ground(vector=(0.0, 0.0, 1.0))
    """
    x, y, z = point
    axes = (
        Ground((1, 0, 0)),
        Ground((0, 1, 0)),
        Ground((0, 0, 1)),
    )
    return Frame(Ground((x, y, z)), axes)


def along(direction: Array, frame: Frame, where: Callable[[Attached], Array] = INITIAL) -> Attached:
    """The vector, fixed in a frame, that has a direction (3,) at the start; `where` returns the
    vector of a director.  A direction outside the plane of two directors raises `InputError`."""
    check(
        lies_in(direction, frame, where),
        f"A frame has no direction {direction.tolist()} in the plane of its directors; "
        "give one with three directors.",
    )
    components = [float(where(director) @ direction) for director in frame.directors]
    return combine(components, frame.directors)


def lies_in(direction: Array, frame: Frame, where: Callable[[Attached], Array] = INITIAL) -> bool:
    """Whether a direction (3,) is a combination of the directors of a frame at the start."""
    directors = np.array([where(director) for director in frame.directors])
    # The sum of the components along orthonormal directors.
    projection = directors @ direction @ directors
    return bool(np.allclose(projection, direction, rtol=0, atol=SAME_DIRECTION))


def is_normal(axis: Array, side: Frame, where: Callable[[Attached], Array] = INITIAL) -> bool:
    """Whether an axis is normal to all directors of a frame: the normal of a beam's section."""
    components = [where(director) @ axis for director in side.directors]
    return bool(np.allclose(components, 0, atol=SAME_DIRECTION))


def across(axis: Vector, side: Frame) -> Frame:
    """The side of a hinge as a frame whose directors span the normals of the axis: itself if all of
    its directors are normal to the axis, else completed to three directors."""
    return side if is_normal(unit(axis), side) else side.complete


def hinge_angle(a: Frame, b: Frame, axis: Vector, rest: float) -> PointMeasure:
    """The measures (cos φ, sin φ) of the rotation φ of b relative to a about an axis since the
    start, less `rest` [rad], which are quadratic in three unit vectors normal to the axis: one is
    fixed in b, two in a."""
    # Unit vectors (3,) at the start: p, q and the axis are a right-handed triad.
    p, q = perpendicular_pair(unit(axis))
    moving = along(p, b)
    # Vectors of a at the rest angle and a quarter turn beyond it: the angle counts from rest, and
    # its jump from π to -π is opposite to it.
    c = math.cos(rest)
    s = math.sin(rest)
    zero = along(c * p + s * q, a)
    quarter = along(c * q - s * p, a)
    # Two measures, moving·zero and moving·quarter, of the stacked vectors.
    cosine = np.zeros((3, 3))
    cosine[0, 1] = cosine[1, 0] = 1.0
    sine = np.zeros((3, 3))
    sine[0, 2] = sine[2, 0] = 1.0
    return PointMeasure(
        ports=[(moving, zero, quarter)],
        H=np.array([np.kron(cosine, np.eye(3)), np.kron(sine, np.eye(3))]),
        L=np.zeros((2, 9)),
        c=np.zeros(2),
    )


class SectionFrame(OneNode):
    """A massless body that follows a section of a beam and has its normal as a further director.

    Problem.  Products of the directors of two sections in one plane do not change to first order
    when one of them tilts; a joint needs products with the normal of a section.

    Idea.  The body has a point x and directors n, d2, d3, which are constrained to the point x_s
    and the directors s2, s3 of the section:

        x - x_s = 0   d2 - s2 = 0   d3 - s3 = 0   ½(n·n - 1) = 0   n·s2 = n·s3 = 0               (1)

    These measures are quadratic and objective, so that joints of beams conserve the same quantities
    as those of rigid bodies.

    Args:
        section: frame with the two directors s2, s3.
        origin: the point x_s of the section.
    """

    description = "the frame of the section"

    def __init__(self, section: Frame, origin: Port) -> None:
        self._section = (origin, *section.directors)
        self._origin = origin
        self.name = f"frame of {section.name or origin.body.name}"
        self.comm = origin.body.comm
        self._make_node(FRAME_SIZE)

    @property
    def frame(self) -> Frame:
        """The frame at x with the directors n, d2, d3."""
        x, *directors = self._vectors()
        return Frame(x, tuple(directors))

    def _vectors(self) -> tuple[Port, ...]:
        """x, n, d2 and d3 as ports."""
        return tuple(self.vector(k) for k in range(4))

    def requires(self) -> Iterable[Any]:
        yield self._origin.body

    def initial_state(self) -> tuple[Array, Array]:
        """Coordinates and rates (12,) of x, n = s2 × s3, d2 and d3, from those of the section.
        Collective."""
        # Point x and directors s2, s3 of the section; q and v are coordinates and rates (12,).
        x, s2, s3 = (port.initial() for port in self._section)
        x_rate, s2_rate, s3_rate = (port.initial_rate() for port in self._section)
        normal = np.cross(s2, s3)
        normal_rate = np.cross(s2_rate, s3) + np.cross(s2, s3_rate)
        q = np.concatenate([x, normal, s2, s3])
        v = np.concatenate([x_rate, normal_rate, s2_rate, s3_rate])
        own_size = FRAME_SIZE * self.block.index_map.size_local
        return q[:own_size], v[:own_size]

    def terms(self, start: State) -> Iterable[Term]:
        """The constraints (1)."""
        # The functions are ½ X·H X + L·X + c of the stacked vectors X = (x, n, d2, d3, x_s, s2,
        # s3).
        followers = [0, 2, 3]
        followed = [4, 5, 6]
        normal = 1
        unit_rows = np.eye(7)
        same = unit_rows[followers] - unit_rows[followed]
        # n·n, n·s2, n·s3; the symmetric matrix of ½ X·H X has a product twice.
        products = np.zeros((3, 7, 7))
        for k, other in enumerate((normal, 5, 6)):
            products[k, normal, other] = 1.0
            products[k, other, normal] = 1.0
        H = np.concatenate([np.zeros((9, 21, 21)), np.kron(products, np.eye(3))])
        L = np.concatenate([np.kron(same, np.eye(3)), np.zeros((3, 21))])
        c = np.concatenate([np.zeros(9), [-0.5, 0.0, 0.0]])
        ports = (*self._vectors(), *self._section)
        measure = PointMeasure([ports], H, L, c)
        yield PointConstraint(f"{self.name} follows", measure)


def bodies_of(*sides: Attached | Frame | Line) -> Iterable[Any]:
    """The bodies of the sides of a joint; one may come several times."""
    for side in sides:
        vectors = (side.origin, *side.directors) if isinstance(side, Frame | Line) else (side,)
        # Vectors of the ground belong to no body.
        for vector in vectors:
            if isinstance(vector, Port):
                yield vector.body


@dataclass(frozen=True, eq=False)
class Between(Item):
    """Two sides, at least one of which moves."""

    a: Attached | Frame
    b: Attached | Frame

    def __post_init__(self) -> None:
        check(
            bool(list(bodies_of(self.a, self.b))),
            f"{type(self).__name__} '{self.name}' joins the ground to itself; "
            "give a port of a body.",
        )
        ends = [
            (one.body, one.nodes, one.weights, one.vectors)
            for one in (self.a, self.b)
            if isinstance(one, Port)
        ]
        check(
            len(ends) < 2 or ends[0] != ends[1],
            f"{type(self).__name__} '{self.name}' joins a point to itself; give two points.",
        )

    @property
    def _sides(self) -> tuple[Attached | Frame, Attached | Frame]:
        """The sides as the equations have them: joints may complete a frame to three directors."""
        return self.a, self.b

    def requires(self) -> Iterable[Item]:
        yield from bodies_of(*self._sides)


class DrawnAsLines(Item, ABC):
    """An item of a scene that pictures show as straight lines between points of bodies."""

    @property
    @abstractmethod
    def lines_to_draw(self) -> Sequence[tuple[Attached, Attached]]:
        """The two ends of each line."""


@dataclass(frozen=True, eq=False)
class LineBetween(Between, DrawnAsLines):
    """Two points between which pictures show a straight line."""

    a: Attached
    b: Attached

    @property
    def lines_to_draw(self) -> Sequence[tuple[Attached, Attached]]:
        """The two ends of the line."""
        return [(self.a, self.b)]


@dataclass(frozen=True, eq=False)
class FrameJoint(Between):
    """Frames of two different bodies, or of one and the ground."""

    a: Frame
    b: Frame

    def __post_init__(self) -> None:
        super().__post_init__()
        a = self.a.origin
        b = self.b.origin
        # Within one body a joint would hold a deformation, or repeat what its rigidity says.
        if isinstance(a, Port) and isinstance(b, Port):
            check(
                a.body is not b.body,
                f"{type(self).__name__} '{self.name}' joins '{a.body.name}' to itself; "
                "join two bodies.",
            )
