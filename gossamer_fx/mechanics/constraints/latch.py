"""Latches, which are engaged and released in a run, and joints that are released."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from gossamer_fx.core.algebra.point_measures import PointMeasure
from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.lookups import check_in_scene
from gossamer_fx.core.model.body import Array, unit
from gossamer_fx.core.model.state import HasSystem, State
from gossamer_fx.core.model.terms import MeasuresStart, Term
from gossamer_fx.mechanics.bodies.frames import (
    Frame,
    across,
    along,
    bodies_of,
    hinge_angle,
    lies_in,
)
from gossamer_fx.mechanics.constraints.joint import (
    BallJoint,
    CylindricalJoint,
    FixedJoint,
    Link,
    PrismaticJoint,
    RevoluteJoint,
    UniversalJoint,
    offset,
)
from gossamer_fx.mechanics.terms.point_constraints import (
    LatchState,
    PointConstraint,
    multipliers_of,
)


@check_arguments
@dataclass(frozen=True, eq=False)
class Latch(MeasuresStart):
    """A lock of the motion that a hinge or rail leaves free, engaged and released in a run.

    `engage` and `release` are actions of events, `position` and `load` probes: a latch acts at an
    angle, a time, another event, or yields to a force.  They take effect at the end of the step.

    Engaged, it holds angle or travel where they are.  Velocities jump to the nearest ones, in the
    metric of the mass, that keep all constraints: a plastic impact, which conserves momentum and
    angular momentum.  The energy that it takes counts as dissipated, by the name of the latch.
    The generalised-α method refuses it: it would keep the accelerations from before the impact.

    Args:
        joint: a `RevoluteJoint` or `PrismaticJoint`, which joins the scene by itself.
        angle: of the hinge from the start to where it is to engage [rad], less than a turn: angles
            are counted within half a turn of the middle of this way.
        engaged: whether it holds at the start.
        name: name in messages and output.

    Raises:
        InputError: another joint; an angle for a rail, or of a turn; when it engages: what it holds
            is held already, or something that moves has no mass.

    Example:
        Two bars with moments of inertia of 1 kg m², one of which turns with 1 rad/s, lose 0.25 J.

        >>> z = (0.0, 0.0, 1.0)
        >>> one = gx.RigidBody(1.0, (1.0, 1.0, 1.0), name="one")
        >>> other = gx.RigidBody(1.0, (1.0, 1.0, 1.0), name="other", spin=z)
        >>> hinge = gx.constraints.RevoluteJoint(one.frame(), other.frame(), axis=z)
        >>> latch = gx.constraints.Latch(hinge)
        >>> deployed = gx.When(latch.position, 0.5, then=latch.engage)
        >>> run = gx.Simulation(gx.Scene(latch), gx.Midpoint(0.1), events=[deployed])
        >>> run.run(until=1.0)
        >>> round(run.totals.losses["latch"], 9)
        0.25
    """

    joint: RevoluteJoint | PrismaticJoint
    _: KW_ONLY
    angle: Annotated[float, Range(-2 * math.pi, 2 * math.pi, "rad", above=True, below=True)] = 0.0
    engaged: bool = False
    name: str = "latch"

    def __post_init__(self) -> None:
        check(
            isinstance(self.joint, RevoluteJoint) or self.angle == 0,
            f"Latch '{self.name}': '{self.joint.name}' is a rail, which has no angle; "
            "leave angle out.",
        )

    @cached_property
    def _sides(self) -> tuple[Frame, Frame]:
        """The frames of the joint, a beam's section with its normal if the measure needs it."""
        joint = self.joint
        if isinstance(joint, RevoluteJoint):
            return across(joint.axis, joint.a), across(joint.axis, joint.b)
        a = joint.a if lies_in(unit(joint.axis), joint.a) else joint.a.complete
        return a, joint.b

    @cached_property
    def _measure(self) -> PointMeasure:
        """(cos, sin) of the angle beyond half of `angle` of a hinge, the travel [m] of a rail."""
        a, b = self._sides
        if isinstance(self.joint, RevoluteJoint):
            return hinge_angle(a, b, self.joint.axis, self.angle / 2)
        return offset(a.origin, b.origin, along(unit(self.joint.axis), a))

    def requires(self) -> Iterable[Any]:
        yield self.joint
        yield from bodies_of(*self._sides)

    def terms(self, start: State) -> Iterable[Term]:
        """One constraint of the free motion, which a released latch does not impose."""
        latch = LatchState(self._measure)
        if self.engaged:
            latch.engage(start)
        yield PointConstraint(self.name, self._measure, latch=latch)

    def engage(self, run: HasSystem) -> None:
        """Let the latch hold from the end of the step on: an action of events."""
        self._state(run).is_wanted = True

    def release(self, run: HasSystem) -> None:
        """Let the latch go from the end of the step on: an action of events."""
        self._state(run).is_wanted = False

    def is_engaged(self, run: HasSystem) -> bool:
        """Whether the latch holds in the present state."""
        return self._state(run).is_engaged

    def position(self, run: HasSystem) -> float:
        """The angle of b against a from the start [rad], or the distance of the origins of a rail
        along its axis [m]: a probe."""
        measures = self._values(run)
        # A rail has one measure, its travel; a hinge has cosine and sine.
        if len(measures) == 1:
            return float(measures[0])
        cosine, sine = measures
        return self.angle / 2 + math.atan2(sine, cosine)

    def load(self, run: HasSystem) -> float:
        """The size of the moment [N m] or force [N] that the latch bore in the last step: a
        probe."""
        # One rank has the multipliers as one row, all others have no row.
        own = multipliers_of(self._term(run), run.system.unknowns).sum(axis=0)
        λ: Array = run.system.comm.allreduce(own)
        # A rail has one multiplier, the force [N].
        if len(λ) == 1:
            return abs(float(λ[0]))
        # A hinge has those of cosine and sine of its angle, which give the moment [N m] by the
        # derivatives of both by the angle.
        cosine, sine = self._values(run)
        return abs(float(λ @ np.array([-sine, cosine])))

    def _values(self, run: HasSystem) -> Array:
        """Values (m,) of `_measure` in the present state: one of a rail, two of a hinge.
        Collective."""
        return self._measure.at(run.system.unknowns.state.vectors(self._measure.ports[0]).ravel())

    def _term(self, run: HasSystem) -> PointConstraint:
        """The constraint in the scene of a run; `InputError` if there is none."""
        terms = run.system.unknowns.terms_of(self)
        check_in_scene(f"Latch '{self.name}'", bool(terms))
        return terms[0]

    def _state(self, run: HasSystem) -> LatchState:
        """The history variables of the latch in the scene of a run."""
        latch = self._term(run).latch
        assert latch is not None
        return latch


@check_arguments
@dataclass(frozen=True, eq=False)
class HoldDown(MeasuresStart):
    """A joint that holds from the start of a run until it is released, as of a stage or a folded
    boom.

    `release` is an action of events, so that it lets go at a time or another event, or at a force,
    of which `gx.probes.JointForce` is the probe.  It takes effect at the end of the step, and takes
    no energy.  The generalised-α method refuses it.

    Args:
        joint: which takes part in the scene by this item only.

    Raises:
        InputError: another item than a joint.

    Example:
        A spring between two bodies, compressed by 0.1 m, drives them apart.

        >>> one = gx.RigidBody(1.0, (1.0, 1.0, 1.0), name="one")
        >>> other = gx.RigidBody(3.0, (1.0, 1.0, 1.0), name="other")
        >>> clamp = gx.constraints.HoldDown(gx.constraints.FixedJoint(one.frame(), other.frame()))
        >>> ends = one.port_at((-0.1, 0.0, 0.0)), other.port_at((0.1, 0.0, 0.0))
        >>> spring = gx.connectors.Stop(*ends, stiffness=60.0, length=0.3)
        >>> separation = gx.At(1.0, then=clamp.release)
        >>> run = gx.Simulation(gx.Scene(clamp, spring), gx.Midpoint(0.01), events=[separation])
        >>> run.run(until=3.0)
        >>> round(run.totals.kinetic, 9)
        0.3
    """

    joint: (
        BallJoint
        | CylindricalJoint
        | FixedJoint
        | Link
        | PrismaticJoint
        | RevoluteJoint
        | UniversalJoint
    )

    # Those of the joint.
    name: str = field(init=False)
    a: Any = field(init=False)
    b: Any = field(init=False)

    def __post_init__(self) -> None:
        for what in ("name", "a", "b"):
            object.__setattr__(self, what, getattr(self.joint, what))

    def requires(self) -> Iterable[Any]:
        return self.joint.requires()

    def terms(self, start: State) -> Iterable[Term]:
        """The constraints of the joint, each with the state by which it is released."""
        for term in self.joint.terms(start):
            assert isinstance(term, PointConstraint)
            yield replace(term, latch=LatchState(term.measure, holds_all=True))

    def release(self, run: HasSystem) -> None:
        """Let the joint go from the end of the step on: an action of events."""
        for latch in self._states(run):
            latch.is_wanted = False

    def is_engaged(self, run: HasSystem) -> bool:
        """Whether the joint holds in the present state."""
        return self._states(run)[0].is_engaged

    def _states(self, run: HasSystem) -> list[LatchState]:
        """The history variables of each constraint of the joint in the scene of a run; `InputError`
        if it has none."""
        terms = run.system.unknowns.terms_of(self)
        check_in_scene(f"HoldDown '{self.name}'", bool(terms))
        return [term.latch for term in terms]
