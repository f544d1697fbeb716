"""Forces that supports and joints exert, from the residual and the multipliers of the last
solution."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.algebra.point_measures import Gather, PointMeasure, attach, evaluated_here
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Attached, Port, Vector
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.frames import DrawnAsLines, Frame
from gossamer_fx.mechanics.terms.point_constraints import PointConstraint, multipliers_of
from gossamer_fx.mechanics.terms.supports import Support
from gossamer_fx.solve.system.system import System


@runtime_checkable
class NamedPart(Protocol):
    """A support or joint of a scene."""

    @property
    def name(self) -> str: ...

    def terms(self, start: State) -> Iterable[Term]: ...


@runtime_checkable
class Joint(NamedPart, Protocol):
    """A joint of two sides, each a port or a frame."""

    @property
    def a(self) -> Any: ...

    @property
    def b(self) -> Any: ...


def support_force(system: System, support: NamedPart, about: Vector) -> tuple[Array, Array]:
    """Force and moment that a support exerts in the last solution.  Collective.

    Args:
        about: point (3,) [m] of the moment, the same on every rank.

    Returns:
        Force (3,) [N] and moment (3,) [N m], the same on every rank.
    """
    centre = np.asarray(about, dtype=float)
    # A support fixes coordinates, or holds rotations by constraints with multipliers, or both.
    terms = [
        t for t in system.unknowns.terms_of(support) if isinstance(t, Support | PointConstraint)
    ]
    check(bool(terms), _not_found(system, support, "support"))
    total = np.zeros((2, 3))
    for term in terms:
        if isinstance(term, Support):
            total += _support_share(system, term, centre)
        else:
            total += _constraint_share(
                system,
                term.measure,
                λ=multipliers_of(term, system.unknowns),
                counts=lambda port: True,
                centre=centre,
            )
    total = system.comm.allreduce(total)
    return total[0], total[1]


def joint_force(
    system: System, joint: Joint, about: Vector = (0.0, 0.0, 0.0)
) -> tuple[Array, Array]:
    """Force and moment that a joint exerts on its second side `b` in the last solution.
    Collective.

    Side `a` bears the opposite.

    Args:
        about: point (3,) [m] of the moment.

    Returns:
        Force (3,) [N] and moment (3,) [N m], the same on every rank.
    """
    centre = np.asarray(about, dtype=float)
    terms = [term for term in system.unknowns.terms_of(joint) if isinstance(term, PointConstraint)]
    check(bool(terms), _not_found(system, joint, "joint"))
    # The ground has no unknowns: the force on it is the opposite of that on the other side.
    second = list(_bodies(joint.b))
    sign, mine = (1.0, second) if second else (-1.0, list(_bodies(joint.a)))

    def on_side(port: Port) -> bool:
        return any(port.body is body for body in mine)

    total = np.zeros((2, 3))
    for term in terms:
        λ = multipliers_of(term, system.unknowns)
        total += sign * _constraint_share(system, term.measure, λ, on_side, centre)
    total = system.comm.allreduce(total)
    return total[0], total[1]


def _not_found(system: System, item: NamedPart, wanted: str) -> str:
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
    if isinstance(item, DrawnAsLines):
        return f"'{name}' is a {kind}, which pulls along its line; ask for its gx.probes.Tension."
    if any(isinstance(term, Support) for term in system.unknowns.terms_of(item)):
        return (
            f"'{name}' is a {kind}, a support and not a joint; ask for its force by "
            "equilibrium.reaction."
        )
    return (
        f"'{name}' is a {kind}, which holds nothing exactly and has no force as a {wanted}; ask "
        "for the displacement or rotation of its ports, from which its law gives the force."
    )


def _bodies(side: Attached | Frame) -> Iterable[Any]:
    """Bodies of a port or frame; a joint may hold the section of a beam by the separate body of its
    complete frame, which is included."""
    vectors = (side.origin, side.complete.origin) if isinstance(side, Frame) else (side,)
    for vector in vectors:
        if isinstance(vector, Port):
            yield vector.body


def _support_share(system: System, term: Support, centre: Array) -> Array:
    """This rank's share of force [N] and moment [N m], (2, 3), of coordinates that a support holds.

    Supports that hold one coordinate together bear equal parts of its force, so that all reactions
    balance the loads.

    Args:
        centre: point (3,) [m] of the moment.
    """
    owned = system.unknowns.block(term.body).owned
    vectors = term.body.block.size // 3
    mine = _owned_coordinates(system, term)
    holders = np.zeros(system.unknowns.numbering.size_local)
    for other in system.unknowns.terms:
        if isinstance(other, Support) and other.body is term.body:
            holders[_owned_coordinates(system, other)] += 1
    # Reactions are stored for all fixed coordinates of the system, in their order.
    reactions = system.unknowns.supports.reactions[
        np.searchsorted(system.unknowns.supports.held, mine)
    ]
    all_forces = np.zeros(system.unknowns.numbering.size_local)
    all_forces[mine] = reactions / holders[mine]
    forces = all_forces[owned].reshape(-1, vectors, 3)
    arms = system.unknowns.q0.array_r[owned].reshape(-1, vectors, 3).copy()
    # Only positions have an arm about the centre; directors turn about their own origin.
    arms[:, 0] -= centre
    return np.array([forces[:, 0].sum(axis=0), np.cross(arms, forces).sum(axis=(0, 1))])


def _owned_coordinates(system: System, term: Support) -> npt.NDArray[np.int64]:
    """Local numbers of the coordinates that a support holds on this rank, each once."""
    owned = system.unknowns.block(term.body).owned
    on_this_rank = term.dofs[term.dofs < owned.stop - owned.start]
    return np.unique(on_this_rank).astype(np.int64) + owned.start


def _constraint_share(
    system: System,
    measure: PointMeasure,
    λ: Array,
    counts: Callable[[Port], bool],
    centre: Array,
) -> Array:
    """Force and moment that one constraint exerts on some of its ports: this rank's share.

    A port is a point or direction of a body.  Collective.

    Args:
        measure: m measures e(X) of each of the n tuples of ports that this rank evaluates.
        λ: their multipliers (n, m), [N] for distances of points.
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
        own, attached, gather(system.unknowns.q0), gather(system.unknowns.previous), λ, strict=True
    )
    for ports, (_, P, o), q_end, q_start, multipliers in of_tuples:
        # Where the forces of the last step acted.
        X = P @ ((1 - α) * q_start + α * q_end) + o
        # The measures have the derivatives H X + L by X.
        forces = -(multipliers @ (measure.H @ X + measure.L)).reshape(-1, 3)
        for port, x, f in zip(ports, X.reshape(-1, 3), forces, strict=True):
            # Forces on the ground balance those on the other side.
            if isinstance(port, Port) and counts(port):
                # Each node of a port has a weight w and the number v of one of its vectors: 0 for
                # the position, others for directors.
                vectors = port.vectors or (0,) * len(port.weights)
                of_points = sum(w for w, v in zip(port.weights, vectors, strict=True) if v == 0)
                total[0] += of_points * f  # one for a point of the body, zero for a direction
                total[1] += np.cross(x - of_points * centre, f)
    return total
