"""Nodes that move as one piece: an edge that stays straight, a hub, an end plate.

With the piece's position x_c and directors d, and the coordinates ξ_k of node k along them at the
start:

    rigid                  x_k = x_c + Σ ξ_ki d_i
    sliding in a plane     (x_k - x_c)·n = 0                     with n = p × q,
                           Σ (x_k - x_c)·p = Σ (x_k - x_c)·q = 0   the position of the piece,
                           Σ (ξ_kq p - ξ_kp q)·x_k = 0             and its angle in its plane
    sliding along a line   x_k = x_c + ξ_k d, where d may change its length

All are linear or quadratic measures that rigid motions do not change: the multipliers do no work,
and both momenta are conserved, except where the piece is fixed.  The region is loaded by `Force` on
its port and by `Torque` on its frame: force and moment are given, and the motion is found.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.point_measures import PointMeasure
from gossamer_fx.core.algebra.rank_exchange import maximum_over_ranks
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.relations import at_most_one
from gossamer_fx.core.model.body import Array, Port
from gossamer_fx.core.model.state import InitialCondition, InitialState, State
from gossamer_fx.core.model.terms import MeasuresMesh, MeasuresStart, Term
from gossamer_fx.mechanics.bodies.beam import Beam
from gossamer_fx.mechanics.bodies.frames import Frame, Line
from gossamer_fx.mechanics.bodies.meshed import Meshed
from gossamer_fx.mechanics.bodies.rigid_body import RigidBody, RigidPiece, fitted
from gossamer_fx.mechanics.constraints.fixed import Component, check_support
from gossamer_fx.mechanics.constraints.joint import coincidence
from gossamer_fx.mechanics.terms.point_constraints import PointConstraint
from gossamer_fx.mechanics.terms.supports import Support

# Largest misfit of the nodes and a rigid motion that a fold map gives them, over their size.
FIT = 1e-6


@check_arguments(at_most_one("sliding", "rigid_body"))
@dataclass(frozen=True, eq=False)
class RigidRegion(MeasuresMesh, MeasuresStart, InitialCondition):
    """A rigid region: the nodes of a named group move as one piece.

    Args:
        body: a film, plate or cable; the slope of a plate is free there.
        group: name of points, curves or surfaces of its mesh, with two nodes at least.
        rigid_body: a rigid body that the nodes are fixed to, e.g. a hub with its mass; None: a
            piece without mass.
        sliding: whether the nodes slide in the plane that the piece carries, as on an end plate
            without friction; those on a straight line stay on it and spread evenly.  Otherwise the
            distances between them are constant.
        fixed_components: which of x, y, z (0, 1, 2) the piece does not move along, nor its axes:
            (2,) where all of the body is held in the plane z = const.
        name: name in messages and output.

    Raises:
        InputError: a beam, a group of one point, one that slides but fills space, or slides on a
            rigid body; when the scene is compiled, a group that a fold map folds.

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
    fixed_components: tuple[Component, ...] = ()
    name: str = ""
    stage: ClassVar[int] = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "fixed_components", tuple(map(int, self.fixed_components)))
        check(
            not isinstance(self.body, Beam),
            f"RigidRegion: '{self.body.name}' is a beam, whose sections are rigid by themselves; "
            "use their frame.",
        )
        check_support("RigidRegion", self.body, self.group)
        if not self.name:
            object.__setattr__(self, "name", f"{self.body.name}/{self.group} rigid")
        count = self._fit[0].shape[0] - 1
        check(count > 0, f"'{self.name}' is one point; apply forces to its port.")
        check(
            not (self.sliding and count == 3),
            f"'{self.name}' slides, but its nodes are not in one plane; "
            "leave sliding out, or name a plane edge.",
        )

    # ---- what it is loaded and joined by ---------------------------------------------------------

    def port(self) -> Port:
        """The centre of its nodes."""
        if self.rigid_body is None:
            return self.piece.port()
        return self.rigid_body.port_at(self._centre)

    @cached_property
    def frame(self) -> Frame:
        """Its centre and axes, for torques, joints and probes; a region on one line has no rotation
        about it, see `line`.  Collective at the first use."""
        if self.rigid_body is not None:
            return self.rigid_body.frame_at(self._centre)
        directors = self.piece.directors
        check(
            len(directors) > 1,
            f"The nodes of '{self.name}' are on one line, about which it has no rotation; "
            "apply torques to its line.",
        )
        return Frame(self.piece.port(), directors, name=self.name)

    @cached_property
    def line(self) -> Line:
        """Centre and direction of a straight region, for torques across it.  Collective at the
        first use."""
        check(
            self.rigid_body is None and len(self.piece.directors) == 1,
            f"The nodes of '{self.name}' are not on one line, or fixed to a rigid body; "
            "apply torques to its frame.",
        )
        return Line(self.piece.port(), self.piece.directors)

    @property
    def a(self) -> Port:
        """A node of the body, as the first side of a joint."""
        # The lowest node of all ranks; a rank without nodes must not win.
        lowest = min(self._nodes(), default=sys.maxsize)
        node = self.body.comm.allreduce(lowest, MPI.MIN)
        return Port(self.body, (node,))

    @property
    def b(self) -> Port:
        """The piece, as the second side of a joint: `probes.JointForce` is what the body exerts on
        it."""
        return self.port()

    # ---- the equations ---------------------------------------------------------------------------

    @cached_property
    def piece(self) -> RigidPiece:
        """The piece without mass that the nodes of the region are tied to, if not to a rigid body.

        It has a position [m] and one director for each dimension of the set of nodes; nodes that
        slide in a plane have the normal as third director.  Collective at the first use.
        """
        start, rates, _ = self._fit
        if self.sliding and len(start) == 3:
            # Nodes in a plane have the directors p and q; sliding also needs n = p × q.
            p, q = start[1:]
            p_rate, q_rate = rates[1:]
            n_rate = np.cross(p_rate, q) + np.cross(p, q_rate)
            start = np.vstack([start, np.cross(p, q)])
            rates = np.vstack([rates, n_rate])
        # The one director of nodes that slide along a line may change its length.
        slides_along_line = self.sliding and len(start) == 2
        return RigidPiece(
            name=f"piece of {self.name}",
            owner=self.body,
            start=start,
            rates=rates,
            rigid=not slides_along_line,
        )

    @cached_property
    def _own(self) -> Array:
        """Local nodes (n,) of the region that this rank owns."""
        nodes = self.body.nodes(self.group)
        return nodes[nodes < self.body.block.index_map.size_local]

    @cached_property
    def _fit(self) -> tuple[Array, Array, Array]:
        """Frame, rates of the frame and coordinates of the nodes in the initial state that the body
        has by itself, see `fitted`."""
        coordinates, velocities = self.body.initial_state()
        return fitted(self.body.comm, self._of_nodes(coordinates), self._of_nodes(velocities))

    def _of_nodes(self, unknowns: Array) -> Array:
        """The positions [m] or velocities (n, 3) of the nodes among all unknowns of the body."""
        return unknowns.reshape(-1, self.body.block.size)[self._own, :3]

    @cached_property
    def _centre(self) -> list[float]:
        """Mean position [m] of the nodes in the state of `_fit`."""
        frame, _, _ = self._fit
        return frame[0].tolist()

    def initialise(self, start: InitialState) -> None:
        """Move the piece with its nodes where a fold map has moved these.  `InputError` if they are
        folded, or if the port or frame of a region on a rigid body was made before.  Collective."""
        comm = self.body.comm
        x = self._of_nodes(start.made(self.body))
        X = self._of_nodes(self.body.initial_state()[0])
        if not comm.allreduce(not np.array_equal(x, X)):
            return
        if self.rigid_body is not None:
            check(
                "_centre" not in vars(self),
                f"'{self.name}': its port or frame was made before '{self.body.name}' is folded; "
                f"use those of '{self.rigid_body.name}'.",
            )
            return
        # The images of centre and directors in the affine motion that takes X to x.
        _, image, along = fitted(comm, X, x)
        misfit = np.abs(image[0] + along @ image[1:] - x).max(initial=0.0)
        stretch = np.abs(image[1:] @ image[1:].T - np.eye(len(image) - 1)).max()
        size = np.abs(along).max(initial=0.0)
        misfit, size = maximum_over_ranks(comm, np.array([misfit, size]))
        check(
            misfit <= FIT * size and stretch <= FIT,
            f"'{self.name}' is folded at the start, off by {misfit:.3g} m from a rigid motion; "
            "name nodes of one panel.",
        )
        if len(self.piece.directors) > len(image) - 1:
            image = np.vstack([image, np.cross(image[1], image[2])])
        # One rank has the node of the piece.
        nodes = image[None][: self.piece.block.index_map.size_local]
        start.place(self.piece, nodes, as_made=True)

    def _nodes(self) -> Sequence[int]:
        """Global numbers of this rank's nodes."""
        return [int(node) for node in self.body.block.index_map.local_to_global(self._own)]

    def _pairs(self, start: State) -> list[tuple[Port, Port]]:
        """This rank's nodes of the region, each with the point that it is tied to, as ports."""
        # ξ (k,) [m] are the coordinates of a node along the directors of the piece.
        if self.rigid_body is None:
            _, _, coordinates = self._fit
            targets = [self.piece.port(*map(float, ξ)) for ξ in coordinates]
        else:
            # A fold map or another initial condition may have moved the nodes from the mesh, and
            # the rigid body from where it was made.
            positions = start[self.body].positions()[self._own]
            frame = self.rigid_body.frame()
            centre = start.vector(frame.origin)
            directors = start.vectors(frame.directors)
            coordinates = (positions - centre) @ directors.T
            targets = [self.rigid_body.port(list(map(float, ξ))) for ξ in coordinates]
        nodes = [Port(self.body, (node,)) for node in self._nodes()]
        return list(zip(nodes, targets, strict=True))

    @property
    def _carrier(self) -> RigidPiece | RigidBody:
        """The body that the nodes are tied to."""
        if self.rigid_body is None:
            return self.piece
        return self.rigid_body

    def requires(self) -> Iterable[Any]:
        yield self.body
        yield self._carrier

    def terms(self, start: State) -> Iterable[Term]:
        """The constraints that couple the nodes to a rigid piece, and the support of that piece if
        components are fixed.  Nodes that slide stay in the plane of the piece; others coincide with
        their points of it.  Collective."""
        if self.fixed_components:
            piece = self._carrier
            # The components of the position and of all directors.
            vectors = np.arange(piece.block.index_map.size_local * piece.block.size // 3)
            dofs = (3 * vectors[:, None] + np.array(self.fixed_components)).ravel().astype(np.int32)
            yield Support(f"{self.name} held", piece, dofs)
        if self.sliding and len(self.piece.directors) == 3:
            yield from self._slides()
            return
        yield coincidence(self.name, *self._pairs(start))

    def _slides(self) -> Iterable[Term]:
        """The constraints of nodes that slide in a plane of a rigid piece without mass.
        Collective.

        With the piece's centre x_c and its axes p, q in the plane and n normal to it: each node x_k
        stays in the plane, (x_k - x_c)·n = 0; the mean of the nodes stays at x_c; and the nodes do
        not turn about n on average.
        """
        p, q, n = self.piece.directors
        centre = self.piece.port()

        # The product (x_k - x_c)·n of the stacked vectors X = (x_k, x_c, n), as ½ X·H X + L·X + c.
        product = np.zeros((3, 3))
        product[0, 2] = product[2, 0] = 1.0
        product[1, 2] = product[2, 1] = -1.0
        H = np.kron(product, np.eye(3))[None]
        L = np.zeros((1, 9))
        c = np.zeros(1)
        heights = [(Port(self.body, (node,)), centre, n) for node in self._nodes()]
        yield PointConstraint(self.name, PointMeasure(heights, H, L, c))

        # The means are over the nodes of all ranks: one port depends on all of them.
        _, _, own_coordinates = self._fit
        nodes: list[int] = []
        coordinates: list[list[float]] = []
        for nodes_of_rank, coordinates_of_rank in self.body.comm.allgather(
            (self._nodes(), own_coordinates.tolist())
        ):
            nodes += nodes_of_rank
            coordinates += coordinates_of_rank
        count = len(nodes)
        mean = Port(self.body, tuple(nodes), weights=(1.0 / count,) * count)
        for k, d in enumerate((p, q)):
            measure = PointMeasure([(mean, centre, d)], H, L, c)
            yield PointConstraint(f"{self.name} centre {k + 1}", measure)

        # With the coordinates ξ_p, ξ_q of the nodes along p and q the turn about n is, on average,
        # zero where (Σ ξ_q x_k)·p - (Σ ξ_p x_k)·q is: two products in one measure.  Its weights are
        # divided by their norm, so that the measure has the unit of a length, as the others.
        ξ = np.array(coordinates) / np.linalg.norm(coordinates)
        of_p = Port(self.body, tuple(nodes), weights=tuple(map(float, ξ[:, 0])))
        of_q = Port(self.body, tuple(nodes), weights=tuple(map(float, ξ[:, 1])))
        rotation = np.zeros((4, 4))
        rotation[0, 2] = rotation[2, 0] = 1.0
        rotation[1, 3] = rotation[3, 1] = -1.0
        measure = PointMeasure(
            ports=[(of_q, of_p, p, q)],
            H=np.kron(rotation, np.eye(3))[None],
            L=np.zeros((1, 12)),
            c=np.zeros(1),
        )
        yield PointConstraint(f"{self.name} spin", measure)
