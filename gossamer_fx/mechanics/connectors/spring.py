"""Springs, ropes, stops and dampers between points, and masses at them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from gossamer_fx.core.algebra.point_measures import PointMeasure, PointPort
from gossamer_fx.core.checks.arguments import (
    Direction,
    Mark,
    at_least,
    check_arguments,
    not_negative,
    positive,
)
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.relations import as_many, exactly_one
from gossamer_fx.core.laws.tracing import Number, at_most
from gossamer_fx.core.model.body import Attached, Port, unit
from gossamer_fx.core.model.item import Item
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Parameter, Term
from gossamer_fx.mechanics.bodies.frames import Between, DrawnAsLines, LineBetween, bodies_of
from gossamer_fx.mechanics.terms.rows import (
    AttachedKineticEnergy,
    Response,
    Rows,
    one_sided_average,
    positive_part,
)

STIFFNESS = Parameter("stiffness", "N/m", "k")
LENGTH = Parameter("length", "m", "L")
DAMPING = Parameter("damping", "N s/m", "c")

Stiffness = Annotated[float, positive("N/m")]
Length = Annotated[float, positive("m")]
# Two points that are not both of the ground.
MOVES = Mark(lambda ends: any(bodies_of(*ends)), "two points, at least one of them of a body")
LengthOrZero = Annotated[float, not_negative("m")]
Damping = Annotated[float, positive("N s/m")]
DampingOrZero = Annotated[float, not_negative("N s/m")]


# [m²] Lower bound of e = ½ l², so that a spring whose ends coincide has no division by zero.
SMALLEST_MEASURE = 1e-300


def length_of(e: Number) -> Number:
    """Length l [m] of the measure e = ½ l² [m²]."""
    return np.sqrt(2 * at_most(e, SMALLEST_MEASURE, holds=SMALLEST_MEASURE, fails=e))


def quadratic(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """ψ = ½ k Σ e_i² of the measures e of each spring."""
    k = numbers.k
    stress = [k * (start + end) / 2 for start, end in zip(e0, e1, strict=True)]
    return Response(stress, energy=k * sum(end * end for end in e1) / 2)


def length_spring(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """ψ = ½ k (l - L)² of the length l = √(2e), e = ½|x_a - x_b|².

    With l0 and l1 at the ends of the step, S_mean = Δψ/Δe = k (1 - 2L/(l0 + l1)).
    """
    l1 = length_of(e1[0])
    mean_length = (length_of(e0[0]) + l1) / 2
    stress = numbers.k * (mean_length - numbers.L) / mean_length
    return Response([stress], energy=numbers.k * (l1 - numbers.L) ** 2 / 2)


def rope(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """`length_spring` that only pulls: ψ = ½ k max(l - L, 0)².  In a step that passes the natural
    length the mean stress is the quotient Δψ/Δe itself."""
    return _one_sided(e0, e1, numbers, side=1)


def stop(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """`length_spring` that only pushes: ψ = ½ k max(L - l, 0)²."""
    return _one_sided(e0, e1, numbers, side=-1)


def _one_sided(e0: Any, e1: Any, numbers: Any, side: int) -> Response:
    l0 = length_of(e0[0])
    l1 = length_of(e1[0])
    # Stretches [m] at both ends, positive where the spring acts.
    y0 = side * (l0 - numbers.L)
    y1 = side * (l1 - numbers.L)
    # Δe = mean_length Δl, so that S_mean is the mean force over the mean length.
    stress = numbers.k * side * one_sided_average(y0, y1) / ((l0 + l1) / 2)
    return Response([stress], energy=numbers.k * positive_part(y1) ** 2 / 2)


def length_damper(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """Axial force c l̇ of the length l = √(2e): S_mean = 2 c (l1 - l0)/(h (l0 + l1))."""
    l0 = length_of(e0[0])
    l1 = length_of(e1[0])
    force = numbers.c / h * (l1 - l0)
    return Response([2 * force / (l0 + l1)], loss=force * (l1 - l0))


def rope_damper(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """Viscous force f = c ds/dt of a rope of length L, with its stretch s = max(l - L, 0).

    f is not below minus the mean tension k s_mean of the step, so that the rope pulls or is slack.
    With S_mean = 2 f/(l0 + l1) the loss f Δl is never negative.
    """
    l0 = length_of(e0[0])
    l1 = length_of(e1[0])
    y0 = l0 - numbers.L
    y1 = l1 - numbers.L
    viscous = numbers.c * (positive_part(y1) - positive_part(y0)) / h
    # A rope does not push: its whole force, tension and viscous, is zero at the least.
    least = -numbers.k * one_sided_average(y0, y1)
    force = at_most(viscous, least, holds=least, fails=viscous)
    return Response([2 * force / (l0 + l1)], loss=force * (l1 - l0))


def half_distance_squared(a: Attached, b: Attached) -> PointMeasure:
    """The measure e = ½|x_a - x_b|² [m²] of two points."""
    difference = np.hstack([np.eye(3), -np.eye(3)])
    return PointMeasure([(a, b)], (difference.T @ difference)[None], np.zeros((1, 6)), np.zeros(1))


def natural_length(
    what: str, a: Attached, b: Attached, *, stiffness: float, tension: float, start: State
) -> float:
    """Natural length [m] with which a spring has a tension [N] in the shape in which a scene
    starts; `what` names it in messages.  Collective."""
    distance = float(np.linalg.norm(start.vector(a) - start.vector(b)))
    length = distance - tension / stiffness
    check(
        length > 0,
        f"{what}: its initial_tension is {tension:g} N, which a stiffness of {stiffness:g} N/m does"
        f" not have between points that are {distance:.4g} m apart; give a larger stiffness, or its"
        " length.",
    )
    return length


@dataclass(frozen=True, eq=False)
class LengthConnector(Between):
    """A stiffness between two points, by its `law` in both directions or one."""

    a: Attached
    b: Attached
    _: KW_ONLY
    stiffness: Stiffness
    length: Length | None

    law: ClassVar[Any] = staticmethod(length_spring)

    def terms(self, start: State) -> Iterable[Term]:
        measure = half_distance_squared(self.a, self.b)
        numbers = {"k": self.stiffness, "L": self.natural_length(start)}
        yield Rows(self.name, measure, self.law, numbers, (STIFFNESS, LENGTH))

    def natural_length(self, start: State) -> float:
        """Natural length [m] in a scene that starts in a state.  Collective."""
        assert self.length is not None
        return self.length


@check_arguments(exactly_one("length", "initial_tension"))
@dataclass(frozen=True, eq=False)
class TensionedConnector(LengthConnector):
    """A connector that may have a tension at the start of the scene in place of a length."""

    _: KW_ONLY
    length: LengthOrZero | None = None
    initial_tension: float | None = None

    def natural_length(self, start: State) -> float:
        if self.initial_tension is None:
            return super().natural_length(start)
        return natural_length(
            f"{type(self).__name__} '{self.name}'",
            self.a,
            self.b,
            stiffness=self.stiffness,
            tension=self.initial_tension,
            start=start,
        )


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Spring(TensionedConnector, LineBetween):
    """A linear spring between two points: ψ = ½ k (|x_a - x_b| - L)².

    Args:
        a, b: ports of bodies; one of them may be a `Ground`.
        stiffness: k [N/m], positive.
        length: L [m], at which the spring is at rest; zero or positive.
        initial_tension: force [N] in the shape in which the scene starts, in place of a length;
            negative for compression.
        name: name in messages and output.

    Raises:
        InputError: two points of the ground, a number out of its range, length and tension or none
            of them; when the scene is compiled: a tension that needs a length below zero.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> statics = gx.Equilibrium(gx.Scene(weight, spring))
        >>> result = statics.find()
        >>> gx.fields.positions(statics, mass).round(6)
        array([[ 0. ,  0. , -1.1]])
    """

    name: str = "spring"


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Rope(TensionedConnector, LineBetween):
    """A rope without mass: it holds two points within its length.

    Its tension is k (l - L) where its ends are l > L apart, and zero where they are nearer.

    Args:
        a, b: ports of bodies; one of them may be a `Ground`.
        stiffness: k = EA/L [N/m], positive.
        length: L [m], positive.
        initial_tension: tension [N] in the shape in which the scene starts, in place of a length;
            zero or positive.
        damping: c [N s/m], zero or positive.  The tension of a stretched rope is k (l - L) + c
            dl/dt, but never negative.
        name: name in messages and output.

    Raises:
        InputError: as of `Spring`.

    Example:
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> gx.connectors.Rope(mass.port(), top, stiffness=1e4, length=1.0, damping=0.1).length
        1.0
    """

    length: Length | None = None
    initial_tension: Annotated[float, not_negative("N")] | None = None
    damping: DampingOrZero = 0.0
    name: str = "rope"

    law = staticmethod(rope)

    def terms(self, start: State) -> Iterable[Term]:
        yield from super().terms(start)
        if self.damping:
            length = self.natural_length(start)
            yield _rope_damping(self, half_distance_squared(self.a, self.b), length, LENGTH)


def _rope_damping(
    item: Rope | RopeBundle, measure: PointMeasure, length: float, parameter: Parameter
) -> Rows:
    """The damper of a rope of a length.  It gets the stiffness, too, by which it keeps the tension
    of both together from falling below zero."""
    return Rows(
        f"{item.name} damping",
        measure,
        rope_damper,
        {"c": item.damping, "k": item.stiffness, "L": length},
        (STIFFNESS, parameter, DAMPING),
        is_viscous=True,
        stores=False,
    )


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Stop(LengthConnector):
    """Keeps two points from coming nearer than a length: the force is k (L - l) below it, else
    zero.

    Two spheres touch at the sum of their radii.  An impact takes as long as half an oscillation on
    the spring and returns all of its energy (π √(m/k), m = m_a m_b/(m_a + m_b), for two free
    bodies); time steps must resolve that.

    Args:
        a, b: ports of bodies; one of them may be a `Ground`.
        stiffness: k [N/m], positive.
        length: L [m] below which the stop pushes, positive.
        name: name in messages and output.

    Raises:
        InputError: two points of the ground, a number out of its range.

    Example:
        >>> floor = gx.Ground((0.0, 0.0, -2.0))
        >>> gx.connectors.Stop(mass.port(), floor, stiffness=1e5, length=0.1).name
        'stop'
    """

    name: str = "stop"

    law = staticmethod(stop)


@check_arguments
@dataclass(frozen=True, eq=False)
class Damper(Between):
    """An axial damper between two points: a force c dl/dt along the line between them, l their
    distance.

    Its loss counts as dissipated.

    Args:
        a, b: ports of bodies; one of them may be a `Ground`.
        damping: c [N s/m], positive.
        name: name in messages and output.

    Raises:
        InputError: two points of the ground, a damping that is not positive.

    Example:
        >>> damper = gx.connectors.Damper(mass.port(), gx.Ground((0.0, 0.0, 0.0)), damping=0.5)
        >>> damper.damping
        0.5
    """

    a: Attached
    b: Attached
    _: KW_ONLY
    damping: Damping
    name: str = "damper"

    def terms(self, start: State) -> Iterable[Term]:
        distance = float(np.linalg.norm(start.vector(self.a) - start.vector(self.b)))
        check(
            distance > 0,
            f"Damper '{self.name}': its two points coincide, so it has no direction; "
            "separate them.",
        )
        yield Rows(
            self.name,
            half_distance_squared(self.a, self.b),
            length_damper,
            {"c": self.damping},
            (DAMPING,),
            is_viscous=True,
            stores=False,
        )


@check_arguments
@dataclass(frozen=True, eq=False)
class AxialSpring(Item):
    """A spring to ground along one direction: ψ = ½ k (n·(x - x0))².

    Args:
        port: the point x.
        stiffness: k [N/m].
        direction: n; only its direction counts.
        origin: x0 [m], where the spring is at rest: by default the origin of the coordinates, not
            the start of the point.

    Raises:
        InputError: a direction of length zero, a stiffness that is not positive.

    Example:
        >>> gx.connectors.AxialSpring(mass.port(), 100.0, direction=(0.0, 0.0, 1.0)).stiffness
        100.0
    """

    port: Port
    stiffness: Stiffness
    _: KW_ONLY
    direction: Direction
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    name: str = "spring"

    def requires(self) -> Iterable[Any]:
        yield self.port.body

    def terms(self, start: State) -> Iterable[Term]:
        n = unit(self.direction)
        # Linear in x: exact for any step, and its matrix is constant.
        rest = -float(n @ np.asarray(self.origin, dtype=float))
        measure = PointMeasure([(self.port,)], np.zeros((1, 3, 3)), n[None], np.array([rest]))
        yield Rows(self.name, measure, quadratic, {"k": self.stiffness}, (STIFFNESS,))


@check_arguments(exactly_one("lengths", "initial_tension"), as_many("ends", "lengths"))
@dataclass(frozen=True, eq=False)
class RopeBundle(DrawnAsLines):
    """Ropes without mass, each as a `Rope`, that are evaluated at once and have one line in the
    ledger.

    Args:
        ends: pairs of ports, or of a port and a `Ground`.
        stiffness: k of each [N/m], positive.
        lengths: L of each [m], positive; as many as pairs.
        initial_tension: tension [N] of each in the shape in which the scene starts, in place of
            lengths; zero or positive.
        damping: c of each [N s/m], which acts where the rope is stretched; zero or positive.
        name: name in messages and output.

    Raises:
        InputError: no rope, not as many lengths as pairs, a number that is not positive, a pair
            without a body.

    Example:
        >>> corners = [film.port("top left"), film.port("top right")]
        >>> ends = [(corner, gx.Ground((0.5, 2.0, 0.0))) for corner in corners]
        >>> ropes = gx.connectors.RopeBundle(ends, stiffness=1e3, lengths=[1.2, 1.2])
        >>> ropes.lengths
        [1.2, 1.2]
    """

    ends: Annotated[Sequence[Annotated[tuple[Attached, Attached], MOVES]], at_least(1)]
    _: KW_ONLY
    stiffness: Stiffness
    lengths: Sequence[Length] = ()
    initial_tension: Annotated[float, not_negative("N")] | None = None
    damping: DampingOrZero = 0.0
    name: str = "ropes"

    def requires(self) -> Iterable[Any]:
        for pair in self.ends:
            yield from bodies_of(*pair)

    def _natural(self, start: State) -> Sequence[float]:
        """Natural lengths [m].  Collective."""
        if self.initial_tension is None:
            return self.lengths
        found = []
        for a, b in self.ends:
            length = natural_length(
                f"RopeBundle '{self.name}'",
                a,
                b,
                stiffness=self.stiffness,
                tension=self.initial_tension,
                start=start,
            )
            found.append(length)
        return found

    @property
    def lines_to_draw(self) -> Sequence[tuple[Attached, Attached]]:
        """The two ends of each rope."""
        return self.ends

    def terms(self, start: State) -> Iterable[Term]:
        # Terms of one name are summed in the energy balance; those of one kind are one array.
        for k, (pair, length) in enumerate(zip(self.ends, self._natural(start), strict=True)):
            measure = half_distance_squared(*pair)
            numbers = {"k": self.stiffness, "L": float(length)}
            parameter = Parameter("lengths", "m", "L", entry=k)
            yield Rows(self.name, measure, rope, numbers, (STIFFNESS, parameter))
            if self.damping:
                yield _rope_damping(self, measure, float(length), parameter)


@check_arguments
@dataclass(frozen=True, eq=False)
class AttachedMass(Item):
    """A mass at a point of a body, e.g. at the tip of a sail: kinetic energy ½ m |v|² of the point.

    It adds no unknowns.  `Gravity` and `Centrifugal` of the body act on it, too.

    Args:
        port: a point of a film, plate, cable, beam or rigid body.
        mass: m [kg], positive.
        name: name in messages and output.

    Raises:
        InputError: a port that is a direction, a mass that is not positive.

    Example:
        >>> gx.connectors.AttachedMass(film.port("top right"), 0.5).mass
        0.5
    """

    port: PointPort
    mass: Annotated[float, positive("kg")]
    _: KW_ONLY
    name: str = "attached mass"

    def requires(self) -> Iterable[Any]:
        yield self.port.body

    def terms(self, start: State) -> Iterable[Term]:
        mass = Parameter("mass", "kg", "mass", changes_mass=True)
        yield AttachedKineticEnergy(
            [(self.port,)],
            np.full((1, 1, 1), self.mass),
            numbers={"mass": self.mass},
            parameters=(mass,),
        )
