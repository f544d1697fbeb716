"""Torsional springs, dampers and stops about the axis of a hinge.

With a direction a of one side and the pair b, c of the other, normal to the axis, the measures e
are cos φ = a·b and sin φ = a·c.  In a step from the angle φ0 to φ1 = φ0 + Δφ with the mean moment
m_mean a law of the angle has the stress

    S_mean = m_mean t,   t = Δφ/(2 sin(Δφ/2)) (-sin φm, cos φm),   φm = (φ0 + φ1)/2

in them, with t·(Δcos, Δsin) = Δφ, so that S_mean·Δe = m_mean Δφ is the work of the moment m_mean
exactly.  Methods of energies are those of `PointDensity`, methods of dampers those of
`PointDamping`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any, ClassVar

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.checks.arguments import check_arguments, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Vector, unit
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Parameter, Term
from gossamer_fx.mechanics.bodies.frames import (
    SAME_DIRECTION,
    Between,
    Frame,
    across,
    bodies_of,
    check_axis,
    hinge_angle,
)
from gossamer_fx.mechanics.terms.point_energies import PointDissipation, PointStoredEnergy

# [rad] Half of the change of the angle below which x/sin x and its derivative are their series: the
# derivative loses digits there, and 1 + x²/6 is exact to 2e-18.
SMALL_ANGLE = 1e-4


def angles(e0: Array, e1: Array) -> tuple[Array, Array]:
    """Angles φ0 (n,) [rad] in (-π, π] of n hinges at the start of a step, and their changes Δφ of
    less than half a turn, from measures (n, 2) in proportion to (cos φ, sin φ) at both ends."""
    φ0 = np.arctan2(e0[:, 1], e0[:, 0])
    φ1 = np.arctan2(e1[:, 1], e1[:, 0])
    # The shorter way round: a step by more than half a turn has the same measures as a shorter one
    # in the other direction.
    Δφ = np.remainder(φ1 - φ0 + np.pi, 2 * np.pi) - np.pi
    return φ0, Δφ


def stress(m: Array, slope: Array, φ0: Array, Δφ: Array, e1: Array) -> tuple[Array, Array]:
    """Stress S (n, 2) [N m] of n hinges with S·(e1 - e0) = m Δφ, the work [J] of the mean moments m
    (n,) [N m] of a step, and ∂S/∂e1 (n, 2, 2).

    `slope` (n,) [N m/rad] is the derivative of m by the angle at the end; φ0 and Δφ are those of
    `angles`, e1 (n, 2) the measures at the end.
    """
    half = Δφ / 2
    φ_mid = φ0 + Δφ / 2
    # The stress m t has the work m Δφ: t is along the chord of the step, longer by half/sin(half).
    is_small = np.abs(half) < SMALL_ANGLE
    safe = np.where(is_small, 1.0, half)
    ratio = np.where(is_small, 1 + half**2 / 6, safe / np.sin(safe))
    # The derivative of the ratio by the angle at the end, which is twice that by `half`.
    exact_growth = (np.sin(safe) - safe * np.cos(safe)) / np.sin(safe) ** 2
    growth = np.where(is_small, half / 3, exact_growth) / 2
    direction = np.stack([-np.sin(φ_mid), np.cos(φ_mid)], axis=1)
    direction_slope = np.stack([-np.cos(φ_mid), -np.sin(φ_mid)], axis=1) / 2
    # dt is the derivative of t by the angle at the end, dφ (n, 2) that of this angle by e1, and D
    # (n, 2, 2) that of S by e1.
    t = ratio[:, None] * direction
    dt = growth[:, None] * direction + ratio[:, None] * direction_slope
    squared_radius = np.sum(e1 * e1, axis=1)[:, None]
    dφ = np.stack([-e1[:, 1], e1[:, 0]], axis=1) / squared_radius
    dS_dφ = slope[:, None] * t + m[:, None] * dt
    D = np.einsum("ni,nj->nij", dS_dφ, dφ)
    return m[:, None] * t, D


class WithinHalfATurn:
    """A density of the angle φ of a hinge that is known for |φ| < π only: its measures are the same
    after a turn.  A step that passes half a turn is refused, as its energy would not close."""

    range: ClassVar[str] = "half a turn"

    def leaves_range(self, e0: Array, e1: Array) -> npt.NDArray[np.bool_]:
        """Whether the angles pass π or -π between measures e0 and e1 (n, 2), (n,)."""
        φ0, Δφ = angles(e0, e1)
        return np.abs(φ0 + Δφ) >= math.pi


@dataclass(frozen=True)
class AngularSpring(WithinHalfATurn):
    """ψ = ½ k (φ - change)², |φ| < π; `change` [rad] is that of the rest angle, which φ counts
    from."""

    k: float
    change: float = 0.0
    stacks: ClassVar[tuple[str, ...]] = ("k", "change")

    def energy(self, e: Array) -> Array:
        φ = np.arctan2(e[:, 1], e[:, 0])
        return self.k * (φ - self.change) ** 2 / 2

    def average(self, e0: Array, e1: Array) -> tuple[Array, Array]:
        φ0, Δφ = angles(e0, e1)
        moment = self.k * (φ0 - self.change + Δφ / 2)
        # k may be one number, or one for each of n springs: + 0 φ0 makes the slope an array (n,).
        return stress(moment, self.k / 2 + 0 * φ0, φ0, Δφ, e1)


@dataclass(frozen=True, eq=False)
class AngularTable(WithinHalfATurn):
    """dψ/dφ [N m] linear between points of a table, constant beyond them, |φ| < π; ψ is zero at the
    angle `zero` [rad]."""

    angle: Array
    moment: Array
    zero: float

    def _integral(self, low: Array, high: Array) -> Array:
        """∫ dψ/dφ dφ [J], (n,), between two angles (n,); exact, without cancellation."""
        ends = np.concatenate([[-np.inf], self.angle, [np.inf]])
        total = np.zeros(len(low))
        for first, last in pairwise(ends):
            begin = np.clip(low, first, last)
            end = np.clip(high, first, last)
            total += (end - begin) * self._moment((begin + end) / 2)
        return total

    def _moment(self, φ: Array) -> Array:
        """dψ/dφ (n,) [N m] at angles φ (n,)."""
        return np.interp(φ, self.angle, self.moment)

    def energy(self, e: Array) -> Array:
        φ = np.arctan2(e[:, 1], e[:, 0])
        return self._integral(np.full(len(φ), self.zero), φ)

    def average(self, e0: Array, e1: Array) -> tuple[Array, Array]:
        φ0, Δφ = angles(e0, e1)
        # Below this change the mean moment would be a quotient of round-off.
        is_small = np.abs(Δφ) < SMALL_ANGLE**2
        safe = np.where(is_small, SMALL_ANGLE**2, Δφ)
        m0 = self._moment(φ0)
        m1 = self._moment(φ0 + safe)
        # The mean moment of the step, and its derivative by the angle at the end; in a step without
        # a change the moment at its start, and half of the table's slope there.
        mean = self._integral(φ0, φ0 + safe) / safe
        moment = np.where(is_small, m0, mean)
        slope = np.where(is_small, (m1 - m0) / (2 * safe), (m1 - mean) / safe)
        return stress(moment, slope, φ0, Δφ, e1)


@dataclass(frozen=True)
class AngularStop(WithinHalfATurn):
    """ψ = ½ k x², x the angle φ beyond [low, high], |φ| < π."""

    k: float
    low: float
    high: float
    stacks: ClassVar[tuple[str, ...]] = ("k", "low", "high")

    def _beyond(self, φ: Array) -> Array:
        """Angles x (n,) [rad] of φ (n,) beyond the limits, negative below them; zero between."""
        return np.minimum(φ - self.low, 0.0) + np.maximum(φ - self.high, 0.0)

    def energy(self, e: Array) -> Array:
        return self.k * self._beyond(np.arctan2(e[:, 1], e[:, 0])) ** 2 / 2

    def average(self, e0: Array, e1: Array) -> tuple[Array, Array]:
        φ0, Δφ = angles(e0, e1)
        x0 = self._beyond(φ0)
        x1 = self._beyond(φ0 + Δφ)
        # The mean moment of the step is (ψ1 - ψ0)/Δφ, of a step without a change the moment itself.
        is_small = np.abs(Δφ) < SMALL_ANGLE**2
        safe = np.where(is_small, 1.0, Δφ)
        moment = self.k * np.where(is_small, (x0 + x1) / 2, (x1 - x0) * (x1 + x0) / (2 * safe))
        slope = np.where(is_small, self.k / 2 * (x0 != 0), (self.k * x1 - moment) / safe)
        return stress(moment, slope, φ0, Δφ, e1)


@dataclass(frozen=True)
class AngularDamper:
    """The mean moment c Δφ/h [N m] in a step of h seconds; c [N m s/rad]."""

    c: float
    stacks: ClassVar[tuple[str, ...]] = ("c",)

    def average(self, e0: Array, e1: Array, h: float) -> tuple[Array, Array]:
        φ0, Δφ = angles(e0, e1)
        return stress(self.c / h * Δφ, self.c / h + 0 * φ0, φ0, Δφ, e1)


@dataclass(frozen=True, eq=False)
class AboutHinge(Between):
    """What acts between two frames, about the axis of their hinge."""

    a: Frame
    b: Frame
    _: KW_ONLY
    axis: Vector

    def __post_init__(self) -> None:
        super().__post_init__()
        check_axis(self)

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
    rest_angle: float = 0.0
    name: str = "torsion spring"

    def __post_init__(self) -> None:
        super().__post_init__()
        check(
            abs(self.rest_angle) < math.pi,
            f"TorsionSpring '{self.name}': rest_angle is {self.rest_angle!r} rad; "
            "stay within half a turn.",
        )

    def terms(self, start: State) -> Iterable[Term]:
        yield PointStoredEnergy(
            self.name,
            hinge_angle(*self._sides, self.axis, self.rest_angle),
            AngularSpring(self.stiffness),
            (
                Parameter("stiffness", "N m/rad", "k"),
                Parameter("rest_angle_change", "rad", "change"),
            ),
        )


@check_arguments
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

    angle: Sequence[float] | Array
    moment: Sequence[float] | Array
    rest_angle: float = 0.0
    name: str = "tabulated torsion"

    def __post_init__(self) -> None:
        super().__post_init__()
        check(
            len(self.angle) == len(self.moment) > 1,
            f"TabulatedTorsion '{self.name}': it has {len(self.angle)} angles and "
            f"{len(self.moment)} moments; give two or more, and as many of both.",
        )
        φ = np.asarray(self.angle, dtype=float)
        check(
            bool((np.diff(φ) > 0).all()) and bool(φ[-1] - φ[0] < 2 * math.pi),
            f"TabulatedTorsion '{self.name}': angle is {self.angle!r}; give rising angles [rad] "
            "over less than a turn.",
        )

    def terms(self, start: State) -> Iterable[Term]:
        # Angles from the middle: their jump by a turn is farthest from both ends.
        middle = (self.angle[0] + self.angle[-1]) / 2
        yield PointStoredEnergy(
            self.name,
            hinge_angle(*self._sides, self.axis, self.rest_angle + middle),
            AngularTable(
                np.asarray(self.angle, float) - middle, np.asarray(self.moment, float), -middle
            ),
        )


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
        measure = hinge_angle(*self._sides, self.axis, 0.0)
        damping = Parameter("damping", "N m s/rad", "c")
        yield PointDissipation(self.name, measure, AngularDamper(self.damping), (damping,))


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
    limits: tuple[float, float]
    name: str = "torsion stop"

    def __post_init__(self) -> None:
        super().__post_init__()
        low, high = self.limits
        check(
            0 <= high - low < 2 * math.pi,
            f"TorsionStop '{self.name}': limits are {low:g} and {high:g} rad; "
            "give two angles in rising order, less than a turn apart.",
        )

    def terms(self, start: State) -> Iterable[Term]:
        low, high = self.limits
        middle = (low + high) / 2
        half = (high - low) / 2
        # Angles from the middle: their jump by a turn is farthest from both limits.
        yield PointStoredEnergy(
            self.name,
            hinge_angle(*self._sides, self.axis, middle),
            AngularStop(self.stiffness, -half, half),
            (Parameter("stiffness", "N m/rad", "k"),),
        )
