"""Torsional springs, dampers and stops about the axis of a hinge.

With a direction a of one side and the pair b, c of the other, normal to the axis, the measures e
are cos φ = a·b and sin φ = a·c.  In a step from the angle φ0 to φ1 = φ0 + Δφ with the mean moment
m_mean a law of the angle has the stress

    S_mean = m_mean t,   t = Δφ/(2 sin(Δφ/2)) (-sin φm, cos φm),   φm = (φ0 + φ1)/2

in them, with t·(Δcos, Δsin) = Δφ, so that S_mean·Δe = m_mean Δφ is the work of the moment m_mean
exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from gossamer_fx.core.checks.arguments import (
    NOT_FALLING,
    RISING,
    Column,
    Direction,
    Mark,
    Range,
    at_least,
    check_arguments,
    positive,
)
from gossamer_fx.core.checks.relations import as_many
from gossamer_fx.core.laws.tracing import Number
from gossamer_fx.core.model.body import unit
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Parameter, Term
from gossamer_fx.mechanics.bodies.frames import (
    SAME_DIRECTION,
    Between,
    Frame,
    across,
    bodies_of,
    hinge_angle,
)
from gossamer_fx.mechanics.terms.rows import (
    Response,
    Rows,
    one_sided_average,
    positive_part,
)

# [rad] Half of the change of the angle below which x/sin x and its derivative are their series: the
# derivative loses digits there, and 1 + x²/6 is exact to 2e-18.
SMALL_ANGLE = 1e-4

# The range in which the angle of a hinge is known
HALF_A_TURN = "half a turn"


def _angle(e: Sequence[Number]) -> Number:
    """The angle φ [rad] in (-π, π] of measures in proportion to (cos φ, sin φ)."""
    return np.arctan2(e[1], e[0])


def _response(
    e0: Sequence[Number],
    e1: Sequence[Number],
    mean_moment: Callable[[Number, Number], Number],
    **others: Number,
) -> Response:
    """The stress S (2,) [N m] with S·(e1 - e0) = m Δφ, the work of a mean moment m [N m] that
    follows from the angle φ0 at the start of a step and that at its end, φ0 + Δφ.

    The law is known for |φ| < π only: its measures are the same after a turn.  A step that passes
    half a turn has an excess, as its energy would not close.
    """
    φ0 = _angle(e0)
    change = _angle(e1) - φ0
    # The shorter way round: a step by more than half a turn has the same measures as a shorter one
    # in the other direction.
    if change < -math.pi:
        change = change + 2 * math.pi
    elif change >= math.pi:
        change = change - 2 * math.pi
    half = change / 2
    # The stress m t has the work m Δφ: t is along the chord of the step, longer by half/sin(half).
    ratio = 1 + half * half / 6 if abs(half) < SMALL_ANGLE else half / np.sin(half)
    m = mean_moment(φ0, φ0 + change)
    stress = [-m * ratio * np.sin(φ0 + half), m * ratio * np.cos(φ0 + half)]
    return Response(stress, excess=(φ0 + change) ** 2 - math.pi**2, **others)


def angular_spring(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """ψ = ½ k (φ - change)²; `change` [rad] is that of the rest angle, which φ counts from."""
    k = numbers.k
    rest = numbers.change

    def moment(φ0: Number, φ1: Number) -> Number:
        return k * ((φ0 + φ1) / 2 - rest)

    return _response(e0, e1, moment, energy=k * (_angle(e1) - rest) ** 2 / 2)


def angular_table(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """dψ/dφ [N m] linear between the angles of a table, constant beyond them: `first` and the
    changes of its slope at each angle.  ψ is zero at the angle `zero` [rad]."""
    corners = list(zip(numbers.angle, numbers.change, strict=True))

    def moment(φ0: Number, φ1: Number) -> Number:
        return numbers.first + sum(c * one_sided_average(φ0 - x, φ1 - x) for x, c in corners)

    φ = _angle(e1)
    energy = moment(numbers.zero, φ) * (φ - numbers.zero)
    return _response(e0, e1, moment, energy=energy)


def angular_stop(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """ψ = ½ k x², x the angle φ beyond ±`half` [rad]."""
    k = numbers.k
    half = numbers.half

    def moment(φ0: Number, φ1: Number) -> Number:
        above = one_sided_average(φ0 - half, φ1 - half)
        return k * (above - one_sided_average(-half - φ0, -half - φ1))

    φ = _angle(e1)
    energy = k * (positive_part(φ - half) ** 2 + positive_part(-half - φ) ** 2) / 2
    return _response(e0, e1, moment, energy=energy)


def angular_damper(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """The mean moment c Δφ/h [N m] in a step of h seconds; c [N m s/rad]."""
    rate = numbers.c / h
    response = _response(e0, e1, lambda φ0, φ1: rate * (φ1 - φ0))
    work = sum(S * (b - a) for S, a, b in zip(response.stress, e0, e1, strict=True))
    return replace(response, loss=work)


# Angles [rad] of less than a turn.
WITHIN_A_TURN = Mark(
    lambda angles: angles[-1] - angles[0] < 2 * math.pi, "{kind}, over less than a turn"
)


@dataclass(frozen=True, eq=False)
class AboutHinge(Between):
    """What acts between two frames, about the axis of their hinge."""

    a: Frame
    b: Frame
    _: KW_ONLY
    axis: Direction

    @cached_property
    def _sides(self) -> tuple[Frame, Frame]:
        """The frames a and b, with the vectors normal to the axis that the angle is made of."""
        return across(self.axis, self.a), across(self.axis, self.b)

    def warnings(self, items: Iterable[Any]) -> Iterator[str]:
        """A warning if no hinge of the scene turns about the axis: the angle is not that of a
        rotation as soon as one side leans against the other.

        A hinge of one side with a third body is enough: mechanisms in a plane have a ball joint
        where another hinge would be too much.
        """
        # A joint of a `HoldDown` is part of the scene by that item only.
        joints = [getattr(item, "joint", item) for item in items]
        sides = set(bodies_of(self.a, self.b))
        for joint in joints:
            # Of the joints in `constraints`, which connectors do not import.
            if getattr(joint, "is_hinge", False) and sides & set(bodies_of(joint.a, joint.b)):
                sine = np.cross(unit(self.axis), unit(joint.axis))
                if np.linalg.norm(sine) <= SAME_DIRECTION:
                    return
        yield (
            f"'{self.name}' acts about the axis {self.axis}, about which no hinge of its bodies "
            "turns, so that its angle has no meaning and energy does not close as soon as they "
            "lean; add a RevoluteJoint of this axis, or give the axis of the hinge."
        )


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class TorsionSpring(AboutHinge):
    """A torsional spring about the axis of a hinge: the moment is -k φ.

    φ is the angle of b against a from the rest angle; a step that passes half a turn is refused.

    Args:
        a, b: frames, also `ground_frame()`, joined by a `RevoluteJoint` of this axis.
        axis: direction in space at the start, of any length; angles count in its right-handed
            sense.
        stiffness: k [N m/rad], positive.
        rest_angle: angle of b against a [rad], from the start, at which the spring is at rest;
            between -π and π.
        name: name in messages and output.

    Raises:
        InputError: two frames of the ground, an axis of length zero, a number out of its range.

    Example:
        >>> y = (0.0, 1.0, 0.0)
        >>> hinge = gx.constraints.RevoluteJoint(gx.ground_frame(), hub.frame(), axis=y)
        >>> spring = gx.connectors.TorsionSpring(
        ...     gx.ground_frame(), hub.frame(), axis=y, stiffness=2.0, rest_angle=0.5
        ... )
        >>> gx.Simulation(gx.Scene(hinge, spring), gx.Midpoint(0.01)).totals.stored
        {'torsion spring': 0.25}
    """

    stiffness: Annotated[float, positive("N m/rad")]
    rest_angle: Annotated[float, Range(-math.pi, math.pi, "rad", above=True, below=True)] = 0.0
    name: str = "torsion spring"

    def terms(self, start: State) -> Iterable[Term]:
        yield Rows(
            self.name,
            hinge_angle(*self._sides, self.axis, self.rest_angle),
            angular_spring,
            {"k": self.stiffness, "change": 0.0},
            (
                Parameter("stiffness", "N m/rad", "k"),
                Parameter("rest_angle_change", "rad", "change"),
            ),
            range=HALF_A_TURN,
        )


@check_arguments(as_many("angle", "moment"))
@dataclass(frozen=True, eq=False, kw_only=True)
class TabulatedTorsion(AboutHinge):
    """A torsional spring about the axis of a hinge by a table of moments, e.g. those of a tape
    spring.

    φ is the angle of b against a from the rest angle, within half a turn of the middle of the
    table.  Moments may fall, as those of a tape spring behind its snap; the energy is their
    integral from φ = 0.

    Args:
        a, b: frames, also `ground_frame()`, joined by a `RevoluteJoint` of this axis.
        axis: direction in space at the start, of any length; angles count in its right-handed
            sense.
        angle: angles φ [rad] of the table, rising, over less than a turn.
        moment: moments [N m] that hold b at these angles, one for each; linear between them,
            constant beyond.
        rest_angle: angle of b against a [rad], from the start, at which φ is zero.
        name: name in messages and output.

    Raises:
        InputError: two frames of the ground, an axis of length zero, columns of different length,
            angles that do not rise or are a turn apart.

    Example:
        >>> y = (0.0, 1.0, 0.0)
        >>> hinge = gx.constraints.RevoluteJoint(gx.ground_frame(), hub.frame(), axis=y)
        >>> tape = gx.connectors.TabulatedTorsion(
        ...     gx.ground_frame(),
        ...     hub.frame(),
        ...     axis=y,
        ...     angle=[-0.5, -0.2, 0.0, 0.2, 0.5],
        ...     moment=[-0.1, -1.0, 0.0, 1.0, 0.1],
        ...     rest_angle=1.5,
        ... )
        >>> run = gx.Simulation(gx.Scene(hinge, tape), gx.Midpoint(0.01))
        >>> round(run.totals.stored["tabulated torsion"], 12)
        0.365
    """

    angle: Annotated[Column, at_least(2), RISING, WITHIN_A_TURN]
    moment: Column
    rest_angle: float = 0.0
    name: str = "tabulated torsion"

    def terms(self, start: State) -> Iterable[Term]:
        # Angles from the middle: their jump by a turn is farthest from both ends.
        middle = (self.angle[0] + self.angle[-1]) / 2
        angle = np.asarray(self.angle, dtype=float)
        moment = np.asarray(self.moment, dtype=float)
        slopes = np.diff(moment) / np.diff(angle)
        numbers = {
            "angle": angle[None] - middle,
            "change": np.diff(slopes, prepend=0.0, append=0.0)[None],
            "first": float(moment[0]),
            "zero": -middle,
        }
        measure = hinge_angle(*self._sides, self.axis, self.rest_angle + middle)
        yield Rows(self.name, measure, angular_table, numbers, range=HALF_A_TURN)


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class TorsionDamper(AboutHinge):
    """A torsional damper about the axis of a hinge: the moment is -c dφ/dt; its loss counts as
    dissipated.

    Args:
        a, b: frames, also `ground_frame()`, joined by a `RevoluteJoint` of this axis.
        axis: direction in space at the start, of any length.
        damping: c [N m s/rad], positive.
        name: name in messages and output.

    Raises:
        InputError: two frames of the ground, an axis of length zero, a damping that is not
            positive.

    Example:
        >>> gx.connectors.TorsionDamper(
        ...     gx.ground_frame(), hub.frame(), axis=(0.0, 1.0, 0.0), damping=0.1
        ... ).damping
        0.1
    """

    damping: Annotated[float, positive("N m s/rad")]
    name: str = "torsion damper"

    def terms(self, start: State) -> Iterable[Term]:
        yield Rows(
            self.name,
            hinge_angle(*self._sides, self.axis, 0.0),
            angular_damper,
            {"c": self.damping},
            (Parameter("damping", "N m s/rad", "c"),),
            is_viscous=True,
            stores=False,
        )


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class TorsionStop(AboutHinge):
    """End stops of a hinge: an elastic moment k x against the angle x beyond either limit.

    As at a `Stop`, an impact returns all of its energy, and time steps must resolve it.

    Args:
        a, b: frames, also `ground_frame()`, joined by a `RevoluteJoint` of this axis.
        axis: direction in space at the start, of any length; angles count in its right-handed
            sense.
        stiffness: k [N m/rad], positive.
        limits: lowest and highest angle of b against a [rad], from the start; in rising order, and
            together less than a turn.
        name: name in messages and output.

    Raises:
        InputError: two frames of the ground, an axis of length zero, a number out of its range.

    Example:
        >>> gx.connectors.TorsionStop(
        ...     gx.ground_frame(),
        ...     hub.frame(),
        ...     axis=(0.0, 1.0, 0.0),
        ...     stiffness=100.0,
        ...     limits=(0.0, 1.57),
        ... ).name
        'torsion stop'
    """

    stiffness: Annotated[float, positive("N m/rad")]
    limits: Annotated[tuple[float, float], NOT_FALLING, WITHIN_A_TURN]
    name: str = "torsion stop"

    def terms(self, start: State) -> Iterable[Term]:
        low, high = self.limits
        middle = (low + high) / 2
        # Angles from the middle: their jump by a turn is farthest from both limits.
        yield Rows(
            self.name,
            hinge_angle(*self._sides, self.axis, middle),
            angular_stop,
            {"k": self.stiffness, "half": (high - low) / 2},
            (Parameter("stiffness", "N m/rad", "k"),),
            range=HALF_A_TURN,
        )
