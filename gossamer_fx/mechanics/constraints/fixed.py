"""Supports: nodes whose position or rotation is fixed or prescribed, also that of the sections of
beams, and rigid bodies that a motor turns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from gossamer_fx.core.algebra.point_measures import PointMeasure
from gossamer_fx.core.algebra.rotations import cross_matrices, rotations
from gossamer_fx.core.checks.arguments import Direction, Range, at_least, check_arguments
from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.checks.relations import at_most_one
from gossamer_fx.core.checks.user_functions import ask_numbers, ask_points
from gossamer_fx.core.model.body import Array, Indices, Port, Vector, unit
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import MeasuresStart, OnBody, Term
from gossamer_fx.mechanics.bodies.meshed import Meshed
from gossamer_fx.mechanics.terms.point_constraints import PointConstraint
from gossamer_fx.mechanics.terms.supports import Support

if TYPE_CHECKING:
    from gossamer_fx.mechanics.bodies.beam import Beam
    from gossamer_fx.mechanics.bodies.rigid_body import RigidBody

ALL_COMPONENTS = (0, 1, 2)


# x, y or z
Component = Annotated[int, Range(0, 2)]


@check_arguments(at_most_one("normal", "components"), at_most_one("normal", "motion"))
@dataclass(frozen=True, eq=False)
class Fixed(OnBody, MeasuresStart):
    """A support: positions of the nodes of a group, and rotations if asked, are fixed or
    prescribed.

    The work of what moves or turns the nodes counts as supplied.  Supports may share nodes where
    they agree to a part of 1e-9, which is checked at each time.  The initial velocity of the nodes
    is that of the body; where it differs from the rate of the motion, the midpoint rule carries the
    difference on as an oscillation of the velocity from step to step.

    The rotation of a beam is that of its sections; that of a plate is its slope across an edge of
    its rim. Films and cables have none.  A section is turned by the shortest rotation from its
    normal to `direction`, then about it by `twist`.  A function of time should begin at the initial
    direction: where it does not, the section jumps in the first step.

    Args:
        body: a film, plate, cable or beam.
        group: name of points, curves or surfaces of its mesh; with the rotation of a plate, curves.
        components: which of x, y, z (0, 1, 2) are fixed or moved; the others are free.
        normal: instead of components, the one direction along which the nodes do not move: they
            slide in the plane with this normal, e.g. a plane of symmetry.
        motion: displacement [m] of the points (3, n) of the stress-free shape at a time [s], of
            shape (3, n).  None: they stay where they start.
        rotation: whether the rotation is fixed, too; a direction or twist fixes it in any case.
        direction: of a beam the normal of the sections, of a plate the vector to which it is
            tangent at the edge, across it; three numbers of any length, or a function of the points
            (3, n) of the stress-free shape and the time [s] that returns (3, n).  None: as it
            is made or folded.
        twist: angle [rad] of the sections of a beam about the direction, or a function of time [s].
        name: name in messages and output.

    Raises:
        InputError: a group that the mesh does not have or that is empty, components that are not
            coordinates, a direction of length zero, a rotation of what has none; during a run, a
            motion or direction that is not finite or of another shape, or two supports that
            disagree about a node.

    Example:
        >>> gx.Fixed(film, "left").name
        'film/left fixed (0, 1, 2)'
        >>> gx.Fixed(film, "bottom", normal=(0.0, 1.0, 0.0)).group
        'bottom'
        >>> def stretch(X, t):
        ...     return 1e-3 * t * X
        >>> gx.Fixed(film, "right", motion=stretch, components=(0,)).components
        (0,)
        >>> gx.Fixed(beam, "start", twist=lambda t: 0.1 * t).name
        'beam/start clamped'
        >>> gx.Fixed(plate, "left", rotation=True).rotation
        True
    """

    body: Meshed
    group: str
    _: KW_ONLY
    components: Annotated[tuple[Component, ...], at_least(1)] = ALL_COMPONENTS
    normal: Direction | None = None
    motion: Callable[[Array, float], Array] | None = None
    rotation: bool = False
    direction: Direction | Callable[[Array, float], Array] | None = None
    twist: float | Callable[[float], float] = 0.0
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "components", tuple(map(int, self.components)))
        check_support("Fixed", self.body, self.group)
        # A direction or a twist is a rotation: it need not be asked for twice.
        turns = self.direction is not None or callable(self.twist) or self.twist != 0
        object.__setattr__(self, "rotation", self.rotation or turns)
        if not self.name:
            object.__setattr__(self, "name", self._default_name())
        if self.rotation:
            self._check_rotation()

    def _default_name(self) -> str:
        """Name of the support, from its body, its group and what it fixes, e.g. "film/left
        clamped".
        """
        where = f"{self.body.name}/{self.group}"
        if self.rotation:
            return f"{where} clamped"
        if self.motion is not None:
            return f"{where} moved {self.components}"
        if self.normal is not None:
            return f"{where} fixed across {tuple(self.normal)}"
        return f"{where} fixed {self.components}"

    def _check_rotation(self) -> None:
        """Check that the body has the rotation that is to be fixed.  Collective for a plate."""
        # Imported here: a scene without clamps does not load beams, plates and their forms.
        from gossamer_fx.mechanics.bodies.beam import Beam
        from gossamer_fx.mechanics.bodies.plate import Plate

        check(
            isinstance(self.body, Beam | Plate),
            f"'{self.name}': "
            f"'{self.body.name}' has no stiffness in bending, so its rotation cannot be fixed; "
            "use a Beam or a Plate, or leave rotation, direction and twist out.",
        )
        if isinstance(self.body, Plate):
            from gossamer_fx.mechanics.constraints.edge_rotation import check_is_rim

            check(
                not callable(self.twist) and self.twist == 0,
                f"'{self.name}': twist is given, but '{self.body.name}' is a plate; "
                "turn its edge by direction.",
            )
            check_is_rim(self.body, self.group)
        else:
            check(
                self.components == ALL_COMPONENTS and self.normal is None,
                f"'{self.name}': components or normal are given, "
                "but a clamped section of a beam has all of its coordinates fixed; "
                "leave them out, or guide its frame by a PrismaticJoint from ground_frame().",
            )

    def terms(self, start: State) -> Iterable[Term]:
        """Fixed coordinates, constraints for a normal direction, and energies that clamp the edge
        of a plate."""
        nodes = self.body.nodes(self.group)
        if self.rotation:
            from gossamer_fx.mechanics.bodies.beam import Beam
            from gossamer_fx.mechanics.bodies.plate import Plate

            if isinstance(self.body, Beam):
                sections = SectionRotation(
                    name=self.name,
                    beam=self.body,
                    nodes=nodes,
                    direction=self.direction,
                    twist=self.twist,
                    motion=self.motion,
                )
                yield sections.support()
                return
            if isinstance(self.body, Plate):
                from gossamer_fx.mechanics.constraints.edge_rotation import EdgeRotation

                rotation = EdgeRotation(self.name, self.body, self.group, self.direction)
                yield from rotation.terms(start)
        if self.normal is not None:
            yield self._plane(nodes, unit(self.normal), start)
        elif self.motion is not None:
            dofs = dofs_of(self.body, nodes, self.components)
            yield Support(self.name, self.body, dofs, self._path(nodes, self.motion))
        else:
            yield Support(self.name, self.body, dofs_of(self.body, nodes, self.components))

    def keeps_measures(self) -> bool:
        # The heights of a plane; other coordinates are held where they are, and are none by which
        # there is a derivative.
        return self.normal is not None

    def _plane(self, nodes: Indices, normal: Array, start: State) -> PointConstraint:
        """The constraint that nodes (n,), owned and ghost, stay in the planes with a unit normal
        (3,) through their initial positions."""
        index_map = self.body.block.index_map
        # A multiplier holds the height of each node; a support could hold coordinates only.
        own = nodes[nodes < index_map.size_local]
        x = start[self.body].positions()[own]
        ports = [(Port(self.body, (int(node),)),) for node in index_map.local_to_global(own)]
        heights = (x @ normal).reshape(-1, 1)
        measure = PointMeasure(ports, H=np.zeros((1, 3, 3)), L=normal[None], c=-heights)
        return PointConstraint(self.name, measure)

    def _path(
        self, nodes: Indices, motion: Callable[[Array, float], Array]
    ) -> Callable[[float], Array]:
        """Prescribed coordinates of nodes (n,), owned and ghost: a function of time [s] that
        returns the chosen components of the positions [m], node by node, from the user's
        displacements (3, n) [m].  It is collective."""
        # Displacements count from the mesh, which is the same wherever the scene starts.
        components = list(self.components)
        X = self.body.space.tabulate_dof_coordinates()[nodes].T

        # X (3, n) [m] are the points of the stress-free shape, u (3, n) [m] their displacements.
        def positions(t: float) -> Array:
            what = f"'{self.name}' at t = {t:.6g} s"
            u = ask_points(self.body.comm, what, lambda: motion(X, t), X.shape)
            return (X + u).T[:, components].ravel()

        return positions


PointMotion = Callable[[Array, float], Array]

# 1 + cosine of two directions below which they are opposite: no rotation between them is the
# shortest.
OPPOSITE = 1e-6


@dataclass(frozen=True)
class SectionRotation:
    """How the sections at nodes of a beam move and turn: by the shortest rotation from their normal
    to `direction`, then about it by `twist`, see `Fixed`."""

    name: str
    beam: Beam
    nodes: Indices
    direction: Vector | PointMotion | None
    twist: float | Callable[[float], float]
    motion: PointMotion | None

    def support(self) -> Support:
        """The support of all coordinates of the sections, positions and directors."""
        size = self.beam.block.size
        # Directors too: three numbers of a position and six of two directors.
        dofs = (size * self.nodes[:, None] + np.arange(size)).ravel().astype(np.int32)
        if self.direction is None and self.motion is None and self.twist == 0:
            return Support(self.name, self.beam, dofs)
        angle = self._angle if callable(self.twist) else None
        return Support(self.name, self.beam, dofs, self._path(), angle)

    def _path(self) -> Callable[[float], Array]:
        """Prescribed coordinates of the sections of a beam: a function of time [s] that returns
        positions [m] and two directors of the n nodes, (9 n,), node by node.  It is collective."""
        # X (3, n) [m] are the nodes of the stress-free shape.
        X = self.beam.space.tabulate_dof_coordinates()[self.nodes].T
        start = self.beam.stress_free(self.nodes)
        motion = self.motion

        def path(t: float) -> Array:
            # Coordinates (n, 3, 3) of the nodes: position and two directors as rows.
            q = start.copy()
            if motion is not None:
                what = f"Motion of '{self.name}' at t = {t:.6g} s"
                q[:, 0] += ask_points(self.beam.comm, what, lambda: motion(X, t), X.shape).T
            # From the stress-free section, not from the last step: errors do not add up.
            normals = np.cross(q[:, 1], q[:, 2])
            turns = self._rotations(X, normals, t)
            q[:, 1:] = np.einsum("nij,nkj->nki", turns, q[:, 1:])
            return q.ravel()

        return path

    def _rotations(self, X: Array, normals: Array, t: float) -> Array:
        """Rotations (n, 3, 3) at a time [s] of the sections with unit normals (n, 3) at nodes X (3,
        n) [m] of the stress-free shape.  Collective."""
        when = f"of '{self.name}' at t = {t:.6g} s"
        wanted = self._directions(X, normals, t, when)
        length = np.linalg.norm(wanted, axis=1, keepdims=True)
        # The check below refuses a length of zero, on all ranks at once.
        wanted = wanted / np.where(length > 0, length, 1.0)
        cosine = np.einsum("ni,ni->n", normals, wanted)
        check_on_all(
            self.beam.comm,
            bool((length > 0).all() and (cosine > OPPOSITE - 1).all()),
            f"The direction {when} is zero, or opposite to that of the section, "
            "so that no turn is the shortest; go there by a function of time.",
        )
        # Rodrigues' formula with sine and cosine taken from the two directions; v (n, 3, 3) is the
        # skew matrix of their cross product.
        v = cross_matrices(np.cross(normals, wanted))
        shortest = np.eye(3) + v + v @ v / (1 + cosine)[:, None, None]
        return rotations(wanted, self._angle(t)) @ shortest

    def _directions(self, X: Array, normals: Array, t: float, when: str) -> Array:
        """Directions (n, 3), of any length, that the unit normals (n, 3) of sections at nodes X (3,
        n) [m] of the stress-free shape are to have at a time [s].  Collective."""
        given = self.direction
        if given is None:
            return normals
        if callable(given):
            return ask_points(self.beam.comm, f"Direction {when}", lambda: given(X, t), X.shape).T
        return np.broadcast_to(np.asarray(given, dtype=float), normals.shape)

    def _angle(self, t: float) -> float:
        """The twist [rad] at time t [s].  Collective."""
        angle = self.twist
        if callable(angle):
            what = f"Twist of '{self.name}' at t = {t:.6g} s"
            return float(ask_numbers(self.beam.comm, what, lambda: angle(t)))
        return float(angle)


def check_support(kind: str, body: Meshed, group: str) -> None:
    """Raise `InputError`, on all ranks, if a support would hold nothing: a group that the mesh does
    not have, or one without nodes of the body.  Collective."""
    body.mesh.group(group, f"{kind} on '{body.name}'")
    # Owned nodes are counted once; a group may have no node on this rank, but not on all.
    nodes = body.nodes(group)
    owned = int((nodes < body.block.index_map.size_local).sum())
    check(
        body.comm.allreduce(owned) > 0,
        f"{kind}: the group '{group}' has no node of '{body.name}', so that nothing would be held; "
        "name another group.",
    )


def dofs_of(body: Meshed, nodes: Indices, components: tuple[int, ...]) -> Indices:
    """Scalar indices (n · components,) of components of the positions of nodes (n,), node by
    node."""
    # The position is the first vector of a node, whatever else it has.
    dofs: Indices = (body.block.size * nodes[:, None] + np.array(components)).ravel()
    return dofs.astype(np.int32)


@check_arguments
@dataclass(frozen=True, eq=False)
class Driven(OnBody, MeasuresStart):
    """A rigid body that turns about an axis as prescribed, as a hub on a motor; its centre is
    fixed, or moves as prescribed.

    The directors are d(t) = R(axis, angle(t)) d(0); the work of the motor counts as supplied.  The
    scene gives the body the rate at which the angle begins, e.g. by `RigidMotion`: a difference
    stays, as of `Fixed` with a motion.  A step of half a turn or more is rejected, and divided.
    Obstacles that are parts of the body (`body=...`) turn and move with it, as a flap that folds a
    film does about a hinge in its centre of mass.

    Args:
        body: what turns.
        axis: direction in space through its centre of mass, of any length.
        angle: [rad] as a function of time [s], zero at the start.
        displacement: of the centre of mass, three numbers [m] as a function of time [s], zero at
            the start; None: it stays.
        name: name in messages and output.

    Raises:
        InputError: an axis of length zero; during a run: an angle or a displacement that is not
            finite.

    Example:
        >>> gx.constraints.Driven(hub, (0.0, 0.0, 1.0), angle=lambda t: 5.0 * t).name
        'motor'
    """

    body: RigidBody
    axis: Direction
    _: KW_ONLY
    angle: Callable[[float], float]
    displacement: Callable[[float], Sequence[float]] | None = None
    name: str = "motor"

    def terms(self, start: State) -> Iterable[Term]:
        body = self.body
        axis = unit(self.axis)
        first = start[body].coordinates().copy()

        def angle(t: float) -> float:
            source = f"Angle of '{self.name}' at t = {t:.6g} s"
            return float(ask_numbers(body.comm, source, lambda: self.angle(t)))

        displacement = self.displacement

        def path(t: float) -> Array:
            """Coordinates of the body on this rank at a time t [s]."""
            # From the first state, not from the last step: errors do not add up.
            turned = first.copy()
            if displacement is not None:
                what = f"Displacement of '{self.name}' at t = {t:.6g} s"
                turned[:, 0] += ask_numbers(body.comm, what, lambda: displacement(t), (3,))
            turned[:, 1:] = first[:, 1:] @ rotations(axis, angle(t)).T
            return turned.ravel()

        yield Support(self.name, body, np.arange(first.size, dtype=np.int32), path, angle)
