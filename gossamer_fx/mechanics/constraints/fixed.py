"""Supports: nodes whose position or rotation is fixed or prescribed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from gossamer_fx.core.algebra.point_measures import PointMeasure
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.user_functions import ask_points
from gossamer_fx.core.model.body import Array, Indices, Port, Vector, unit
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.meshed import Meshed
from gossamer_fx.mechanics.constraints.supported_nodes import check_support, dofs_of
from gossamer_fx.mechanics.terms.point_constraints import PointConstraint
from gossamer_fx.mechanics.terms.supports import Support

ALL_COMPONENTS = (0, 1, 2)


@check_arguments
@dataclass(frozen=True, eq=False)
class Fixed:
    """A support: positions of the nodes of a group, and rotations if asked, are fixed or
    prescribed.

    The work of what moves or turns the nodes counts as supplied.  Their initial velocity is that of
    the body; where it differs from the rate of the motion, the midpoint rule carries the difference
    on as an oscillation of the velocity from step to step.

    The rotation of a beam is that of its sections; that of a plate is its slope across an edge of
    its rim. Films and cables have none.  A section is turned by the shortest rotation from its
    normal to `direction`, then about it by `twist`.  A function of time should begin at the initial
    direction: where it does not, the section jumps in the first step.

    Args:
        body: a film, plate, cable or beam.
        group: name of points, curves or surfaces of its mesh; with the rotation of a plate, curves.
        components: which of x, y, z (0, 1, 2) are fixed or moved; the others are free.
        normal: instead of components, the one direction along which the nodes do not move: they
            slide in the plane with this normal, e.g. a plane of symmetry.  Multipliers hold them,
            so that the matrix is factorised.
        motion: displacement [m] of the points (3, n) of the stress-free shape at a time [s], of
            shape (3, n).  None: they stay where they start.
        rotation: whether the rotation is fixed, too; also with a direction or twist.
        direction: of a beam the normal of the sections, of a plate the vector to which it is
            tangent at the edge, across it; three numbers of any length, or a function of the points
            (3, n) of the stress-free shape and the time [s] that returns (3, n).  None: as it
            starts.
        twist: angle [rad] of the sections of a beam about the direction, or a function of time [s].
        name: name in messages and output.

    Raises:
        InputError: a group that the mesh does not have or that is empty, components that are not
            coordinates, a direction of length zero, a rotation of what has none; during a run, a
            motion or direction that is not finite or of another shape.

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
    components: tuple[int, ...] = ALL_COMPONENTS
    normal: Vector | None = None
    motion: Callable[[Array, float], Array] | None = None
    rotation: bool = False
    direction: Vector | Callable[[Array, float], Array] | None = None
    twist: float | Callable[[float], float] = 0.0
    name: str = ""

    def __post_init__(self) -> None:
        """Check the arguments of the support, and name it if it has no name.  Collective.

        A support fixes or prescribes positions and rotations of the nodes of a named group.

        Raises:
            InputError: a group that the mesh does not have or that is empty, components other than
                0, 1, 2, a normal or direction of length zero, both normal and motion, or a rotation
                of a body that has none.
        """
        object.__setattr__(self, "components", tuple(map(int, self.components)))
        check_support("Fixed", self.body, self.group, self.components)
        # A direction or a twist is a rotation: it need not be asked for twice.
        turns = self.direction is not None or callable(self.twist) or self.twist != 0
        object.__setattr__(self, "rotation", self.rotation or turns)
        if not self.name:
            object.__setattr__(self, "name", self._default_name())
        if self.normal is not None:
            check(
                any(self.normal),
                f"'{self.name}': normal is {self.normal!r}; give three numbers, not all zero.",
            )
            check(
                self.motion is None,
                f"'{self.name}': normal and motion are given; leave one of them out, or give "
                "components.",
            )
        if self.direction is not None and not callable(self.direction):
            check(
                any(self.direction),
                f"'{self.name}': direction is {self.direction!r}; give three numbers, not all "
                "zero.",
            )
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
        """Check that the body has the rotation that is to be fixed.  Collective for a plate.

        Raises:
            InputError: the body is neither beam nor plate, a plate has a twist or edges that are
                not on its rim, or a beam has components or a normal.
        """
        # Imported here: a scene without clamps does not load beams, plates and their forms.
        from gossamer_fx.mechanics.bodies.beam import Beam
        from gossamer_fx.mechanics.bodies.plate import Plate

        check(
            isinstance(self.body, Beam | Plate),
            f"'{self.name}': '{self.body.name}' has no stiffness in bending, so its rotation "
            "cannot be fixed; use a "
            "Beam or a Plate, or leave rotation, direction and twist out.",
        )
        if isinstance(self.body, Plate):
            from gossamer_fx.mechanics.constraints.edge_rotation import check_is_rim

            check(
                not callable(self.twist) and self.twist == 0,
                f"'{self.name}': twist is given, but '{self.body.name}' is a plate; turn its edge "
                "by direction.",
            )
            check_is_rim(self.body, self.group)
        else:
            check(
                self.components == ALL_COMPONENTS and self.normal is None,
                f"'{self.name}': components or normal are given, but a clamped section of a beam "
                "has all of its "
                "coordinates fixed; leave them out.",
            )

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        """The support, or the constraints of sections and slopes where rotations are fixed.

        Yields:
            What the item adds to the equations: fixed coordinates, constraints for a normal
            direction, and energies that clamp the edge of a plate.

        Raises:
            InputError: the direction of a plate lies along its edge.
        """
        nodes = self.body.nodes(self.group)
        if self.rotation:
            from gossamer_fx.mechanics.bodies.beam import Beam
            from gossamer_fx.mechanics.bodies.plate import Plate

            if isinstance(self.body, Beam):
                from gossamer_fx.mechanics.constraints.section_rotation import SectionRotation

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

    def _plane(self, nodes: Indices, normal: Array, start: State) -> PointConstraint:
        """The constraint that nodes stay in the planes through their initial positions.

        Args:
            nodes: local nodes (n,), owned and ghost.
            normal: unit normal (3,) of the planes.
        """
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
        """Prescribed coordinates of nodes as a function of time.

        Args:
            nodes: local nodes (n,), owned and ghost.
            motion: user's function of the points (3, n) [m] of the stress-free shape and time [s]
                that returns displacements (3, n) [m].

        Returns:
            Function of time [s] that returns the chosen components of the positions [m], node by
            node.  It is collective, and raises `InputError` on all ranks for a result of another
            form.
        """
        # Displacements count from the mesh, which is the same wherever the scene starts.
        components = list(self.components)
        X = self.body.space.tabulate_dof_coordinates()[nodes].T

        # X (3, n) [m] are the points of the stress-free shape, u (3, n) [m] their displacements.
        def positions(t: float) -> Array:
            what = f"'{self.name}' at t = {t:.6g} s"
            u = ask_points(self.body.comm, what, lambda: motion(X, t), X.shape)
            return (X + u).T[:, components].ravel()

        return positions
