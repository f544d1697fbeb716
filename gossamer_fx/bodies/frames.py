"""Frames: oriented points of bodies and of the ground; a beam's section with its normal."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from operator import methodcaller
from typing import Any

import numpy as np
from dolfinx.common import IndexMap

from gossamer_fx.algebra.point_measures import PointMeasure
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import Array, Attached, Block, Ground, Port, Vector
from gossamer_fx.model.ports import combine
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term
from gossamer_fx.terms.point_constraints import PointConstraint

# Vectors as bodies have them by themselves, outside of any scene.
INITIAL: Callable[[Attached], Array] = methodcaller("initial")


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
        """The frame with three directors; all that needs the normal of a section shares one."""
        if len(self.directors) == 3 or isinstance(self.origin, Ground):
            return self
        return SectionFrame(self, self.origin).frame


@dataclass(frozen=True, eq=False)
class Line:
    """A point of a body and one director: a straight edge, whose rotation about itself means nothing."""

    origin: Attached
    directors: tuple[Attached, ...]


@check_arguments
def ground_frame(point: Vector = (0.0, 0.0, 0.0)) -> Frame:
    """The axes of inertial space at a point.

    Args:
        point: [m].

    Returns:
        The frame, with the directors x, y, z.

    Example:
        >>> gx.ground_frame((0.0, 0.0, 1.0)).origin
        Ground(vector=(0.0, 0.0, 1.0))
    """
    x, y, z = point
    return Frame(Ground((x, y, z)), (Ground((1, 0, 0)), Ground((0, 1, 0)), Ground((0, 0, 1))))


def along(direction: Array, frame: Frame, where: Callable[[Attached], Array] = INITIAL) -> Attached:
    """The vector fixed in a frame that is `direction` (3,) at the start, or where a function says the vectors are.

    Raises:
        InputError: the frame has two directors and the direction is not in their plane.
    """
    check(
        lies_in(direction, frame, where),
        f"A frame has no direction {direction.tolist()} in the plane of its directors; give one with three directors.",
    )
    return combine([float(where(d) @ direction) for d in frame.directors], frame.directors)


def lies_in(direction: Array, frame: Frame, where: Callable[[Attached], Array] = INITIAL) -> bool:
    """Whether a direction (3,) is a combination of the directors of a frame at the start."""
    directors = np.array([where(d) for d in frame.directors])
    return bool(np.allclose(directors @ direction @ directors, direction, atol=1e-9))


def is_normal(axis: Array, side: Frame, where: Callable[[Attached], Array] = INITIAL) -> bool:
    """Whether an axis is normal to all directors of a frame: the normal of a beam's section."""
    return bool(np.allclose([where(d) @ axis for d in side.directors], 0, atol=1e-9))


class SectionFrame:
    """Point x and directors n, d2, d3 without mass that follow a section (x_s, s2, s3) of a beam, n its normal:

        x - x_s = 0   d2 - s2 = 0   d3 - s3 = 0   ½(n·n - 1) = 0   n·s2 = n·s3 = 0

    Two sections in one plane have no products of their directors that change to first order when one of them tilts; of
    the normal of the one and the directors of the other there are.  As these measures are quadratic and objective, the
    joints of beams conserve what those of rigid bodies do.
    """

    def __init__(self, section: Frame, origin: Port) -> None:
        self._section, self._origin = (origin, *section.directors), origin
        self.name, self.comm = f"frame of {section.name or origin.body.name}", origin.body.comm
        self.block = Block(IndexMap(self.comm, 1 if self.comm.rank == 0 else 0), 12)

    @property
    def frame(self) -> Frame:
        x, *directors = self._vectors()
        return Frame(x, tuple(directors))

    def _vectors(self) -> tuple[Port, ...]:
        return tuple(Port(self, (0,), weights=(1.0,), vectors=(k,)) for k in range(4))

    def requires(self) -> Iterable[Any]:
        yield self._origin.body

    def initial_state(self) -> tuple[Array, Array]:
        x, s2, s3 = (port.initial() for port in self._section)
        vx, v2, v3 = (port.initial_rate() for port in self._section)
        q = np.concatenate([x, np.cross(s2, s3), s2, s3])
        v = np.concatenate([vx, np.cross(v2, s3) + np.cross(s2, v3), v2, v3])
        here = 12 * self.block.index_map.size_local
        return q[:here], v[:here]

    def terms(self, start: State) -> Iterable[Term]:
        # of the stacked vectors (x, n, d2, d3, x_s, s2, s3)
        same = np.eye(7)[[0, 2, 3]] - np.eye(7)[[4, 5, 6]]
        products = np.zeros((3, 7, 7))
        for k, other in enumerate((1, 5, 6)):
            products[k, 1, other] = products[k, other, 1] = 1.0
        H = np.concatenate([np.zeros((9, 21, 21)), np.kron(products, np.eye(3))])
        L = np.concatenate([np.kron(same, np.eye(3)), np.zeros((3, 21))])
        c = np.concatenate([np.zeros(9), [-0.5, 0.0, 0.0]])
        yield PointConstraint(
            f"{self.name} follows", PointMeasure([(*self._vectors(), *self._section)], H, L, c)
        )

    def describe(self, node: int) -> str:
        return "the frame of the section"
