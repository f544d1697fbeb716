"""Probes of contact: functions of a run that return one number, the same on every rank."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.checks.lookups import check_in_scene
from gossamer_fx.core.checks.relations import each_once, some
from gossamer_fx.core.forms.c_source import c_library
from gossamer_fx.core.model.body import WITH_NODES, MeshBody
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.contact.broad_phase.candidates import import_facets
from gossamer_fx.mechanics.contact.contact import CompiledContact, Contact
from gossamer_fx.mechanics.contact.contact_pressure import PressedNodes, pressed_nodes
from gossamer_fx.mechanics.contact.contact_set import ContactSet
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.geometry.curved_cells import least_piece_count
from gossamer_fx.mechanics.contact.kernels.library import HEADER
from gossamer_fx.mechanics.contact.narrow_phase.intersections import find_intersections
from gossamer_fx.mechanics.contact.obstacles import Obstacle
from gossamer_fx.mechanics.contact.pairs import PairDistances
from gossamer_fx.records.probes.points import AXES, AxisName
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.view import ForSystem, StateView


def contact_set_of(contact: Contact, run: Any) -> ContactSet:
    """The compiled pairs of a contact in a run."""
    for compiled in run.system.equations.compiled_as(CompiledContact):
        if compiled.item is contact:
            return compiled
    raise InputError(f"'{contact.name}' is not in the scene; add it, or remove its probe.")


@check_arguments
class ContactGap:
    """Least gap [m] between parts of a contact that are not connected: distance less the radii.

    Bodies of order 2 touch as flat pieces between points of their cells.  The gap is that of the
    pieces, less a bound for the height of the curved cells over them: what it says is free is free,
    and where it is negative, a curved cell may be inside of what it touches.

    Infinite if nothing was within reach of the last search.  A table refuses that, which ends the
    run: record the inverse.

    Args:
        contact: in the scene.

    Example:
        >>> import gossamer_fx as gx
        >>> def probes(contact: gx.Contact) -> gx.Series:
        ...     gap = gx.probes.ContactGap(contact)
        ...     return gx.Series({"1/gap [1/m]": lambda run: 1 / gap(run)})
    """

    def __init__(self, contact: Contact) -> None:
        self.contact = contact

    def __call__(self, run: Any) -> float:
        """The least gap [m] of all candidates in the state of a run.  Collective."""
        contact_set = contact_set_of(self.contact, run)
        x = contact_set.points.at(run.system.unknowns.q0, run.system.unknowns.time)
        # At the accepted state: the pairs' distances of the last iterate may belong to another
        # one.
        pairs = contact_set.candidates
        height = contact_set.mesh.distances_from_pieces(x)[pairs.points]
        # A point and a triangle are (0, 123), two edges (01, 23), a point and an obstacle (0, 123).
        height_of_first = height[:, :2].max(axis=1, initial=0.0)
        height_of_second = height[:, 1:].max(axis=1, initial=0.0)
        gap = PairDistances.of(pairs, x).gap - height_of_first - height_of_second
        return float(run.comm.allreduce(float(gap.min(initial=np.inf)), op=MPI.MIN))


@check_arguments
class ContactForce:
    """Component [N] of the force of a contact on one of its bodies or obstacles: mean of the last
    step; after a restart, until the next step, that of the state alone, without friction.

    Args:
        contact: in the scene.
        body: a film, cable, beam or obstacle of this contact.
        axis: "x", "y" or "z".

    Raises:
        InputError: another axis, or a body that is not in the contact.

    Example:
        >>> import gossamer_fx as gx
        >>> def probes(contact: gx.Contact, floor: gx.contact.Plane) -> gx.Series:
        ...     return gx.Series({"push": gx.probes.ContactForce(contact, floor, axis="z")})
    """

    def __init__(self, contact: Contact, body: MeshBody | Obstacle, *, axis: AxisName) -> None:
        known: list[MeshBody | Obstacle] = [*contact.bodies, *contact.obstacles]
        names = ", ".join(one.name for one in known)
        numbers = [k for k, one in enumerate(known) if one is body]
        check(
            bool(numbers),
            f"'{getattr(body, 'name', body)}' is not in '{contact.name}', which holds: {names}.",
        )
        self.contact = contact
        self.axis: AxisName = axis
        self._number = numbers[0]

    def __call__(self, run: Any) -> float:
        """The component [N] of the mean force in the last step of a run."""
        contact_set = contact_set_of(self.contact, run)
        # Each rank holds the forces of its pairs on all points, so that the sum over ranks is
        # complete.
        of_body = (contact_set.mesh.body == self._number) & contact_set.points.is_position()
        # The forces of the residual are internal ones, opposite to those on the body.
        force = -float(contact_set.forces.on_points[of_body, AXES[self.axis]].sum())
        return float(run.comm.allreduce(force))


class _TouchedNodes:
    """Contact pressures on the nodes of one body of a contact, and the areas of these nodes."""

    def __init__(self, contact: Contact, body: MeshBody) -> None:
        known = ", ".join(one.name for one in contact.bodies)
        check(
            any(one is body for one in contact.bodies),
            f"'{getattr(body, 'name', body)}' is not a body of '{contact.name}', which has: "
            f"{known}.",
        )
        self.contact = contact
        self.body = body

    def _pressed_nodes(self, run: Any) -> PressedNodes:
        """The body's nodes of this rank in the present state of a run.  Collective."""
        return pressed_nodes(self.body, contact_set_of(self.contact, run))


@check_arguments
class ContactPressure(_TouchedNodes):
    """Largest contact pressure [Pa] on a node of a body, mean of the last step, as the field
    `contact_pressure`; 0 without contact.

    Args:
        contact: in the scene.
        body: a film, cable or beam of this contact.

    Raises:
        InputError: a body that is not in the contact.

    Example:
        >>> touching = gx.Contact(film, distance=1e-3)
        >>> pressure = gx.probes.ContactPressure(touching, film)
        >>> pressure(gx.Equilibrium(gx.Scene(film, touching)))
        0.0
    """

    unit = "Pa"

    def __call__(self, run: Any) -> float:
        """The largest pressure [Pa] in the state of a run.  Collective."""
        largest = float(self._pressed_nodes(run).pressure.max(initial=0.0))
        return float(run.system.comm.allreduce(largest, op=MPI.MAX))


@check_arguments
class ContactArea(_TouchedNodes):
    """Area [m²] of the nodes of a body on which contact presses, on the stress-free shape.

    Contact begins to press at its activation distance.  The area is that of whole nodes, so that
    it has an error of the width of a cell along the edge of the contact.

    Args:
        contact: in the scene.
        body: a film, cable or beam of this contact.

    Raises:
        InputError: a body that is not in the contact.

    Example:
        >>> touching = gx.Contact(film, distance=1e-3)
        >>> area = gx.probes.ContactArea(touching, film)
        >>> area(gx.Equilibrium(gx.Scene(film, touching)))
        0.0
    """

    unit = "m²"

    def __call__(self, run: Any) -> float:
        """The area [m²] in the state of a run.  Collective."""
        pressed = self._pressed_nodes(run)
        area = float(pressed.area[pressed.pressure > 0].sum())
        return float(run.system.comm.allreduce(area))


@check_arguments
class Penetrations:
    """Number of pairs of an edge and a triangle that intersect: zero unless contact has failed.

    All edges are compared with all triangles near them, whatever the contact itself knows.  In a
    large scene that takes as long as a Newton iteration, so that it may be done less often.

    Args:
        contact: in the scene.
        every: number of steps from one count to the next; steps between have the last number.

    Raises:
        InputError: `every` is below one.

    Example:
        >>> import gossamer_fx as gx
        >>> def probes(contact: gx.Contact) -> gx.Series:
        ...     return gx.Series({"penetrations": gx.probes.Penetrations(contact)})
    """

    def __init__(self, contact: Contact, *, every: Annotated[int, Range(1)] = 1) -> None:
        self.contact = contact
        self.every = every
        self._last = 0.0
        self._next_step = 0
        self._system: System | None = None  # of the last count

    def __call__(self, run: Any) -> float:
        """The number of the last count, which is made now if it is due.  Collective."""
        step: int = run.step
        # Another run begins at any step: the first call counts.
        if run.system is not self._system or step >= self._next_step:
            self._system = run.system
            self._last = self._count(run)
            self._next_step = step + self.every
        return self._last

    def _count(self, run: Any) -> float:
        """Number of intersecting pairs of all ranks in the present state of a run; collective."""
        contact_set = contact_set_of(self.contact, run)
        mesh = contact_set.mesh
        x = contact_set.points.at(run.system.unknowns.q0, run.system.unknowns.time)
        return float(run.comm.allreduce(len(find_intersections(mesh.surface, x, mesh.own_edges))))


@check_arguments(some("bodies"), each_once("bodies"))
class Crossings:
    """Number of edges of films that intersect a triangle of a film to which they are not connected.

    Exact, see `contact.narrow_phase.intersections`: an edge that only touches a triangle does not
    intersect it.  Films of order 2 are cut into plane triangles.  Each rank looks at the edges that
    it owns, and knows the triangles of other ranks that are near them, as with `Contact`.

    Args:
        bodies: one or several, in the scene.

    Raises:
        InputError: no film, one twice, a reduced one, or something else.

    Example:
        >>> import gossamer_fx as gx
        >>> def probes(film: gx.Membrane) -> gx.Series:
        ...     return gx.Series({"crossings": gx.probes.Crossings(film)})
    """

    def __init__(self, *bodies: Annotated[Membrane, WITH_NODES]) -> None:
        self.bodies = bodies
        self._mesh = ForSystem(
            lambda system: CollisionMesh(
                bodies,
                [],
                radii=[0.0] * len(bodies),
                piece_counts=[least_piece_count(film) for film in bodies],
                system=system.unknowns,
            )
        )

    def __call__(self, run: StateView) -> float:
        """The number of edges that intersect a triangle in the state of a run.  Collective.

        Args:
            run: whose present state is looked at.

        Raises:
            InputError: a film is not in the scene of the run.
        """
        system = run.system
        for film in self.bodies:
            check_in_scene(f"'{film.name}'", film in system.unknowns.bodies)
        c_library(HEADER, run.comm)
        mesh = self._mesh(system)
        x = mesh.points.at(system.unknowns.q0, system.unknowns.time)
        import_facets(mesh, x, x)
        # The points of the mesh may be other ones now.
        x = mesh.points.at(system.unknowns.q0, system.unknowns.time)
        found = find_intersections(mesh.surface, x, mesh.own_edges)
        # An edge counts once, however many triangles it intersects.
        return float(run.comm.allreduce(len(np.unique(found[:, 0]))))
