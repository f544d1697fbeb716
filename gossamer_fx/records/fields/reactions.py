"""Forces that supports, joints and connectors exert, from the residual, the multipliers and the
stresses of the last solution."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from gossamer_fx.core.algebra.point_measures import (
    Gather,
    PointMeasure,
    attach,
    evaluated_here,
    translation_weight,
)
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.forms.compilation import compile_form, constant
from gossamer_fx.core.model.body import Array, Ground, Port, Vector
from gossamer_fx.core.model.item import Item
from gossamer_fx.mechanics.bodies.frames import Between, DrawnAsLines, Frame
from gossamer_fx.mechanics.constraints.latch import HoldDown
from gossamer_fx.mechanics.constraints.rigid_region import RigidRegion
from gossamer_fx.mechanics.constraints.tie import Seam, Tie
from gossamer_fx.mechanics.terms.energies_in_time import EnergiesInTime
from gossamer_fx.mechanics.terms.point_constraints import PointConstraint, multipliers_of
from gossamer_fx.mechanics.terms.quadratic_energies import QuadraticEnergies, QuadraticEnergy
from gossamer_fx.mechanics.terms.rows import CompiledRows
from gossamer_fx.mechanics.terms.supports import Support
from gossamer_fx.solve.system.system import System

# A joint of two sides, each a port, a frame, a line or a region, also one that is held until it is
# released.
Joint = Between | HoldDown | RigidRegion | Tie | Seam


class GroundForce:
    """What the ground exerts on the bodies of a scene through an item in the last solution; of a
    joint or connector between two bodies, what its second side `b` bears.

    Args:
        system: of the scene.
        item: a support, a joint, or a spring, damper, rope, tether or stop.

    Attributes:
        supports, clamps, constraints, connectors: its terms.
        is_counted: whether the force on a port of a constraint or connector counts.

    Raises:
        InputError: the item is not in the scene, or is none of these.
    """

    def __init__(self, system: System, item: Item) -> None:
        self._system = system
        terms = system.unknowns.terms_of(item)
        # A support fixes coordinates, or holds rotations by constraints with multipliers, or those
        # of the edge of a plate by energies.
        self.supports = [term for term in terms if isinstance(term, Support)]
        self.constraints = [term for term in terms if isinstance(term, PointConstraint)]
        self.connectors: list[Any] = [
            term for term in terms if issubclass(term.compiler, CompiledRows)
        ]
        known = self.supports or self.constraints or self.connectors
        if not known:
            raise InputError(_not_found(system, item, "support or joint"))
        self.clamps = [
            ClampedEdge(system, term)
            for term in terms
            if self.supports and issubclass(term.compiler, (QuadraticEnergies, EnergiesInTime))
        ]
        self.is_counted: Callable[[Port], bool] = lambda port: True
        sides: list[list[Any]] = [[], []]
        if isinstance(item, Joint):
            sides = [list(_bodies(side)) for side in (item.a, item.b)]
        if isinstance(item, Joint) and sides[0] and sides[1]:
            check(
                sides[0] != sides[1] or isinstance(item.b, Port),
                f"'{item.name}' joins '{sides[1][0].name}' to itself, so that no one force is that "
                "of it; ask for those of supports.",
            )
            self.is_counted = _on_second_side(item.b, *sides)
        # What has a side on the ground is pushed by it, and all of its ports count.
        elif not self.supports:
            check(
                self._is_on_ground(),
                f"'{item.name}' is a {type(item).__name__} that joins no two bodies and is not on "
                "the ground, so that no one force is that of it; ask for those of supports, or for "
                "the tension of lines.",
            )

    def _is_on_ground(self) -> bool:
        """Whether a measure of the item has a side on the ground.  Collective."""
        own = False
        for term in (*self.constraints, *self.connectors):
            for ports in term.measure.ports:
                # The measure of one point alone, e.g. a height, is one against the ground.
                is_alone = len(ports) == 1 and translation_weight(ports[0]) != 0
                own = own or is_alone or any(isinstance(port, Ground) for port in ports)
        return bool(self._system.comm.allreduce(own, op=MPI.LOR))

    def __call__(self, about: Vector = (0.0, 0.0, 0.0)) -> tuple[Array, Array]:
        """Force (3,) [N] and moment (3,) [N m] about a point (3,) [m], the same on every rank.
        Collective."""
        system = self._system
        centre = np.asarray(about, dtype=float)
        total = np.zeros((2, 3))
        for support in self.supports:
            total += _support_share(system, support, centre)
        for clamp in self.clamps:
            total[1] += clamp.moment_share(centre)
        for term in (*self.constraints, *self.connectors):
            S = self.stresses_of(term)
            total += _measure_share(system, term.measure, S, self.is_counted, centre)
        force, moment = system.comm.allreduce(total)
        return force, moment

    def stresses_of(self, term: Any) -> Array:
        """Multipliers or stresses (n, m) of a constraint or connector, of the tuples of ports that
        this rank evaluates.  Collective."""
        if isinstance(term, PointConstraint):
            return multipliers_of(term, self._system.unknowns)
        [compiled] = self._system.equations.compiled_as(term.compiler)
        found: Array = compiled.stresses_of_step(term)
        return found

    def support_shares(self) -> list[tuple[Support, Array]]:
        """The supports, each with the share (unknowns of this rank,) that it bears of the force on
        a coordinate."""
        return [(term, 1 / _holders(self._system, term)) for term in self.supports]


class ClampedEdge:
    """The moment by which the ground holds the slope of a plate at an edge.

    The energy a(x, x)/2 of the edge does not change if the plate is shifted, but if it is turned:
    in a turn about e_k it does the work a(x, e_k × x), the component of a moment.

    Args:
        system: of the scene.
        term: the `QuadraticEnergy` or `MovingEnergy` of the edge.
    """

    def __init__(self, system: System, term: Any) -> None:
        self._unknowns = system.unknowns
        self._body = term.body
        space = term.body.space
        self._x = fem.Function(space)
        self._w = fem.Function(space)
        # Values of what changes in time with the times at which they are taken.
        self._varying: list[tuple[fem.Function, Callable[[], float]]] = []
        if isinstance(term, QuadraticEnergy):
            form = term.form(self._x, self._w)
        else:
            self._set = term.set
            ends: list[Callable[[], float]] = [lambda: system.unknowns.time]
            if not system.unknowns.rule.acts_at_end:
                ends.append(lambda: system.unknowns.previous_time)
            self._varying = [(fem.Function(term.space), end) for end in ends]
            share = constant(space.mesh, 1 / len(ends))
            form = sum(share * term.form(self._x, self._w, d) for d, _ in self._varying)
        self._work = compile_form(form)

    def moment_share(self, centre: Array) -> Array:
        """The moment (3,) [N m] about a point (3,) [m] on the plate in the last step, this rank's
        share.  Collective."""
        unknowns = self._unknowns
        owned = unknowns.block(self._body).owned
        α = unknowns.rule.alpha
        start, end = unknowns.previous.array_r[owned], unknowns.q0.array_r[owned]
        unknowns.coordinates[self._body].take(self._x, (1 - α) * start + α * end)
        for function, time in self._varying:
            self._set(function, time())
        arms = self._x.x.array.reshape(-1, 3) - centre
        moment = np.zeros(3)
        for k, axis in enumerate(np.eye(3)):
            self._w.x.array[:] = np.cross(axis, arms).ravel()
            moment[k] = -fem.assemble_scalar(self._work)
        return moment


def joint_force(
    system: System, joint: Joint, about: Vector = (0.0, 0.0, 0.0)
) -> tuple[Array, Array]:
    """Force (3,) [N] and moment (3,) [N m] about a point (3,) [m] that a joint exerts on its second
    side `b` in the last solution, the same on every rank; side `a` bears the opposite.
    Collective."""
    terms = system.unknowns.terms_of(joint)
    is_joint = any(isinstance(term, PointConstraint) for term in terms)
    if not is_joint:
        raise InputError(_not_found(system, joint, "joint"))
    force, moment = GroundForce(system, joint)(about)
    # Of the ground on the other side; the ground itself bears the opposite.
    sign = 1.0 if list(_bodies(joint.b)) else -1.0
    return sign * force, sign * moment


def _on_second_side(b: Any, first: list[Any], second: list[Any]) -> Callable[[Port], bool]:
    """Which ports are those of the second side of a joint, of the bodies on both sides."""
    if first == second:
        # Two points of one body.
        return lambda port: port == b
    return lambda port: any(port.body is body for body in second)


def _not_found(system: System, item: Item, wanted: str) -> str:
    """Why the force of an item is not known as that of a support or joint, and what to ask for."""
    name = item.name
    for holder in system.unknowns.items:
        if getattr(holder, "joint", None) is item:
            return f"'{name}' is held by a {type(holder).__name__}; ask for the force of that one."
    if all(other is not item for other in system.unknowns.items):
        return (
            f"'{name}' is not a {wanted} of this scene; add it to the scene, or ask for one that "
            "is in it."
        )
    kind = type(item).__name__
    if any(other is item for other in system.unknowns.bodies):
        return (
            f"'{name}' is a {kind}, a body and not a {wanted}; ask for the force of what holds it, "
            "e.g. of a Fixed, a joint or a Rope of the scene."
        )
    if isinstance(item, DrawnAsLines):
        return f"'{name}' is a {kind}, which pulls along its line; ask for its gx.probes.Tension."
    if any(isinstance(term, Support) for term in system.unknowns.terms_of(item)):
        return (
            f"'{name}' is a {kind}, a support and not a joint; ask for its force by "
            "equilibrium.reaction."
        )
    if name in system.balance.resultants():
        return (
            f"'{name}' is a {kind}, a load and not a {wanted}; ask for its force by "
            f"gx.probes.LoadResultant((0, 0, 0), {name!r}, action='force', axis='z')."
        )
    return (
        f"'{name}' is a {kind}, which holds nothing exactly and has no force as a {wanted}; ask "
        "for gx.probes.Reaction if it ends at the ground, else for the displacement or rotation "
        "of its ports, from which its law gives the force."
    )


def _bodies(side: Any) -> Iterable[Any]:
    """Bodies of a port or frame, or the body itself; a joint may hold the section of a beam by the
    separate body of its complete frame, which is included."""
    vectors = (side.origin, side.complete.origin) if isinstance(side, Frame) else (side,)
    for vector in vectors:
        if isinstance(vector, Port):
            yield vector.body
        elif not isinstance(vector, Ground):
            # A tie has bodies as its sides.
            yield vector


def _support_share(system: System, term: Support, centre: Array) -> Array:
    """This rank's share of force [N] and moment [N m], (2, 3), of coordinates that a support holds.

    Supports that hold one coordinate together bear equal parts of its force, so that all reactions
    balance the loads.

    Args:
        centre: point (3,) [m] of the moment.
    """
    owned = system.unknowns.block(term.body).owned
    vectors = term.body.block.size // 3
    mine = owned_coordinates(system, term)
    holders = _holders(system, term)
    forces_of_supports = system.unknowns.supports.forces
    assert forces_of_supports is not None
    all_forces = np.zeros(system.unknowns.numbering.size_local)
    all_forces[mine] = forces_of_supports.array_r[mine] / holders[mine]
    forces = all_forces[owned].reshape(-1, vectors, 3)
    # Where the forces of the last step acted.
    α = system.unknowns.rule.alpha
    start, end = system.unknowns.previous.array_r[owned], system.unknowns.q0.array_r[owned]
    arms = ((1 - α) * start + α * end).reshape(-1, vectors, 3)
    # Only positions have an arm about the centre; directors turn about their own origin.
    arms[:, 0] -= centre
    return np.array([forces[:, 0].sum(axis=0), np.cross(arms, forces).sum(axis=(0, 1))])


def _holders(system: System, term: Support) -> Array:
    """How many supports hold each coordinate of the body of one (unknowns of this rank,); one where
    none does."""
    holders = np.zeros(system.unknowns.numbering.size_local)
    for other in system.unknowns.terms:
        if isinstance(other, Support) and other.body is term.body:
            holders[owned_coordinates(system, other)] += 1
    return np.maximum(holders, 1.0)


def owned_coordinates(system: System, term: Support) -> npt.NDArray[np.int64]:
    """Local numbers of the coordinates that a support holds on this rank, each once."""
    owned = system.unknowns.block(term.body).owned
    on_this_rank = term.dofs[term.dofs < owned.stop - owned.start]
    return np.unique(on_this_rank).astype(np.int64) + owned.start


def _measure_share(
    system: System,
    measure: PointMeasure,
    S: Array,
    counts: Callable[[Port], bool],
    centre: Array,
) -> Array:
    """Force and moment that a constraint or connector exerts on some of its ports: this rank's
    share.

    A port is a point or direction of a body.  Collective.

    Args:
        measure: m measures e(X) of each of the n tuples of ports that this rank evaluates.
        S: their stresses or multipliers (n, m), [N] for distances of points.
        counts: whether the force on a port is added.
        centre: point of the moment (3,) [m].

    Returns:
        Force [N] and moment [N m], as rows (2, 3).
    """
    # α: weight of the end of the step in the point at which its forces acted.
    α = system.unknowns.rule.alpha
    total = np.zeros((2, 3))
    # The vectors X of a tuple of ports are P q + o, linear in its unknowns q.
    own = [measure.ports[i] for i in evaluated_here(measure.ports)]
    attached = [attach(system.unknowns.numbering, system.unknowns.bodies, ports) for ports in own]
    gather = Gather(system.unknowns.numbering, [indices for indices, _, _ in attached])
    of_tuples = zip(
        own, attached, gather(system.unknowns.q0), gather(system.unknowns.previous), S, strict=True
    )
    for ports, (_, P, o), q_end, q_start, stresses in of_tuples:
        # Where the forces of the last step acted.
        X = P @ ((1 - α) * q_start + α * q_end) + o
        # The measures have the derivatives H X + L by X.
        forces = -(stresses @ (measure.H @ X + measure.L)).reshape(-1, 3)
        for port, x, f in zip(ports, X.reshape(-1, 3), forces, strict=True):
            # Forces on the ground balance those on the other side.
            if isinstance(port, Port) and counts(port):
                # One for a point of the body, zero for a direction.
                of_points = translation_weight(port)
                total[0] += of_points * f
                total[1] += np.cross(x - of_points * centre, f)
    return total
