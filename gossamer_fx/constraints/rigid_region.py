"""Nodes that move as one piece: an edge that stays straight, a hub, an end plate.

With the piece's position x̄ and directors d, and the coordinates ξ_k of node k along them at the start:

    rigid                  x_k = x̄ + Σ ξ_ki d_i
    sliding in a plane     (x_k - x̄)·n = 0, and the means Σ (x_k - x̄)·p = Σ (x_k - x̄)·q = 0,
                           Σ (ξ_kq p - ξ_kp q)·x_k = 0, the position and angle of the piece in its plane; n = p × q
    sliding along a line   x_k = x̄ + ξ_k d, where d may change its length

All are linear or quadratic measures that rigid motions leave as they are: the multipliers do no work, and both momenta
are kept, but where the piece is held.  The region is loaded by `Force` on its port and by `Torque` on its frame: force
and moment are given, and the motion is found.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.algebra.point_measures import PointMeasure
from gossamer_fx.bodies.beam import Beam
from gossamer_fx.bodies.frames import Frame, Line
from gossamer_fx.bodies.meshed import Meshed
from gossamer_fx.bodies.rigid_body import RigidBody
from gossamer_fx.bodies.rigid_piece import RigidPiece, fitted
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.constraints.joint import coincidence
from gossamer_fx.constraints.supported_nodes import check_support
from gossamer_fx.model.body import Array, Port
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term
from gossamer_fx.terms.point_constraints import PointConstraint
from gossamer_fx.terms.supports import Support


@check_arguments
@dataclass(frozen=True, eq=False)
class RigidRegion:
    """A rigid region: the nodes of a named group move as one piece.

    Args:
        body: a film, plate or cable; the slope of a plate is free there.
        group: name of points, curves or surfaces of its mesh, with two nodes at least.
        rigid_body: a rigid body that the nodes are fixed to, e.g. a hub with its mass; None: a piece
            without mass.
        sliding: whether the nodes slide in the plane that the piece carries, as on an end plate without
            friction; those on a straight line stay on it and spread evenly.  Otherwise the
            distances between them are constant.
        fixed_components: which of x, y, z (0, 1, 2) the piece does not move along, nor its axes: (2,)
            where all of the body is held in the plane z = const.
        name: name in messages and output.

    Raises:
        InputError: a beam, a group of one point, one that slides but fills space, or slides on a rigid
            body.

    Example:
        >>> edge = gx.RigidRegion(film, "right")
        >>> pull = gx.loads.Force(edge.port(), (1.0, 0.0, 0.0))
        >>> edge.name
        'film/right rigid'
    """

    body: Meshed
    group: str
    _: KW_ONLY
    rigid_body: RigidBody | None = None
    sliding: bool = False
    fixed_components: tuple[int, ...] = ()
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "fixed_components", tuple(map(int, self.fixed_components)))
        check(
            not isinstance(self.body, Beam),
            f"RigidRegion: '{self.body.name}' is a beam, whose sections are rigid by themselves; use "
            "their frame.",
        )
        check_support("RigidRegion", self.body, self.group, self.fixed_components or (0,))
        if not self.name:
            object.__setattr__(self, "name", f"{self.body.name}/{self.group} rigid")
        check(
            not (self.sliding and self.rigid_body is not None),
            f"'{self.name}' slides, and is fixed to '{getattr(self.rigid_body, 'name', '')}'; "
            "leave one of them out, and join the frame of what slides to the rigid body.",
        )
        count = self._fit[0].shape[0] - 1
        check(count > 0, f"'{self.name}' is one point; apply forces to its port.")
        check(
            not (self.sliding and count == 3),
            f"'{self.name}' slides, but its nodes are not in one plane; leave sliding out, or name a plane edge.",
        )

    # ---- what it is loaded and joined by ------------------------------------------------------------------------

    def port(self) -> Port:
        """The centre of its nodes."""
        return (
            self.piece.port()
            if self.rigid_body is None
            else self.rigid_body.port_at(self._fit[0][0].tolist())
        )

    @cached_property
    def frame(self) -> Frame:
        """Its centre and axes, for torques, joints and probes.

        Raises:
            InputError: its nodes are on one line, about which it has no rotation: see `line`.
        """
        if self.rigid_body is not None:
            return self.rigid_body.frame_at(self._fit[0][0].tolist())
        directors = self.piece.directors
        check(
            len(directors) > 1,
            f"The nodes of '{self.name}' are on one line, about which it has no rotation; apply torques to its line.",
        )
        return Frame(self.piece.port(), directors, name=self.name)

    @cached_property
    def line(self) -> Line:
        """Centre and direction of a straight region, for torques across it.

        Raises:
            InputError: its nodes are not on one line.
        """
        check(
            self.rigid_body is None and len(self.piece.directors) == 1,
            f"The nodes of '{self.name}' are not on one line, or fixed to a rigid body; apply torques to its frame.",
        )
        return Line(self.piece.port(), self.piece.directors)

    @property
    def a(self) -> Port:
        """A node of the body, as the first side of a joint."""
        return Port(
            self.body, (self.body.comm.allreduce(min(self._nodes(), default=sys.maxsize), MPI.MIN),)
        )

    @property
    def b(self) -> Port:
        """The piece, as the second side of a joint: `joint_force` is what the body exerts on it."""
        return self.port()

    # ---- the equations -------------------------------------------------------------------------------------------

    @cached_property
    def piece(self) -> RigidPiece:
        """What the nodes are tied to, if not to a rigid body."""
        start, rates, _ = self._fit
        if self.sliding and len(start) == 3:
            start, rates = (
                np.vstack([start, np.cross(*start[1:])]),
                np.vstack([rates, np.cross(rates[1], start[2]) + np.cross(start[1], rates[2])]),
            )
        return RigidPiece(
            f"piece of {self.name}", self.body, start, rates, not (self.sliding and len(start) == 2)
        )

    @cached_property
    def _own(self) -> Array:
        nodes = self.body.nodes(self.group)
        own: Array = nodes[nodes < self.body.block.index_map.size_local]
        return own

    @cached_property
    def _fit(self) -> tuple[Array, Array, Array]:
        size = self.body.block.size
        x, v = (values.reshape(-1, size)[self._own, :3] for values in self.body.initial_state())
        return fitted(self.body.comm, x, v)

    def _nodes(self) -> Sequence[int]:
        """Global numbers of this rank's nodes."""
        return [int(node) for node in self.body.block.index_map.local_to_global(self._own)]

    def _places(self, start: State) -> list[tuple[Port, Port]]:
        if self.rigid_body is None:
            targets = [self.piece.port(*map(float, ξ)) for ξ in self._fit[2]]
        else:  # where a fold map or another start has placed them
            placed = start[self.body].positions()[self._own]
            targets = [self.rigid_body.port_at(list(map(float, place))) for place in placed]
        return [
            (Port(self.body, (node,)), target)
            for node, target in zip(self._nodes(), targets, strict=True)
        ]

    def requires(self) -> Iterable[Any]:
        yield self.body
        yield self.piece if self.rigid_body is None else self.rigid_body

    def terms(self, start: State) -> Iterable[Term]:
        if self.fixed_components:
            piece = self.piece if self.rigid_body is None else self.rigid_body
            vectors = np.arange(piece.block.index_map.size_local * piece.block.size // 3)
            dofs = (3 * vectors[:, None] + np.array(self.fixed_components)).ravel().astype(np.int32)
            yield Support(f"{self.name} held", piece, dofs)
        if self.sliding and len(self.piece.directors) == 3:
            yield from self._slides()
            return
        yield coincidence(self.name, *self._places(start))

    def _slides(self) -> Iterable[Term]:
        # (x_k - x̄)·n of the stacked vectors (x_k, x̄, n)
        H = np.zeros((3, 3))
        H[0, 2] = H[2, 0] = 1.0
        H[1, 2] = H[2, 1] = -1.0
        p, q, n = self.piece.directors
        places = [(Port(self.body, (node,)), self.piece.port(), n) for node in self._nodes()]
        plane = np.kron(H, np.eye(3))[None], np.zeros((1, 9)), np.zeros(1)
        yield PointConstraint(self.name, PointMeasure(places, *plane))
        nodes, along = (
            [one for part in self.body.comm.allgather(values) for one in part]
            for values in (self._nodes(), self._fit[2].tolist())
        )
        ξ = np.array(along) / np.linalg.norm(along)
        mean = Port(self.body, tuple(nodes), weights=(1.0 / len(nodes),) * len(nodes))
        for k, d in enumerate((p, q)):
            yield PointConstraint(
                f"{self.name} centre {k + 1}", PointMeasure([(mean, self.piece.port(), d)], *plane)
            )
        # (Σ ξ_q x_k)·p - (Σ ξ_p x_k)·q, two products in one measure
        of_p, of_q = (
            Port(self.body, tuple(nodes), weights=tuple(map(float, column))) for column in ξ.T
        )
        turned = np.zeros((4, 4))
        turned[0, 2] = turned[2, 0] = 1.0
        turned[1, 3] = turned[3, 1] = -1.0
        yield PointConstraint(
            f"{self.name} spin",
            PointMeasure(
                [(of_q, of_p, p, q)],
                np.kron(turned, np.eye(3))[None],
                np.zeros((1, 12)),
                np.zeros(1),
            ),
        )
