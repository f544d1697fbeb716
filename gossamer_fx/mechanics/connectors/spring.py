"""Springs, ropes, stops and dampers between points, and masses at them.

Methods of energies are those of `PointDensity`, methods of dampers those of `PointDamping`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from gossamer_fx.core.algebra.point_measures import PointMeasure, translation_weight
from gossamer_fx.core.checks.arguments import check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Attached, Port, unit
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Parameter, Term
from gossamer_fx.mechanics.bodies.frames import Between, LineBetween, bodies_of
from gossamer_fx.mechanics.terms.point_energies import (
    AttachedKineticEnergy,
    PointDissipation,
    PointStoredEnergy,
    one_sided_average,
    one_sided_energy,
)

STIFFNESS = Parameter("stiffness", "N/m", "k")
LENGTH = Parameter("length", "m", "L")

Stiffness = Annotated[float, positive("N/m")]
Length = Annotated[float, positive("m")]
LengthOrZero = Annotated[float, not_negative("m")]
Damping = Annotated[float, positive("N s/m")]
DampingOrZero = Annotated[float, not_negative("N s/m")]


@dataclass(frozen=True)
class Quadratic:
    """ψ(e) = ½ k Σ e_i² of the m measures e of each spring."""

    k: float
    stacks: ClassVar[tuple[str, ...]] = ("k",)

    def energy(self, e: Array) -> Array:
        return self.k * np.sum(e * e, axis=1) / 2

    def average(self, e0: Array, e1: Array) -> tuple[Array, Array]:
        # k may be one number, or one for each of n springs.
        k = np.reshape(self.k, (-1, 1))
        m = e0.shape[1]
        stress = k * (e0 + e1) / 2
        derivative = k[:, :, None] / 2 * np.eye(m)
        return stress, np.broadcast_to(derivative, (*e0.shape, m))


@dataclass(frozen=True)
class LengthSpring:
    """ψ = ½ k (l - L)² of the length l = √(2e), e = ½|x_a - x_b|²; none where l - L has not the
    sign of `side`.

    `side` 1 pulls only (a rope), -1 pushes only (a stop), 0 does both.  With l0 and l1 at the ends
    of the step, S_mean = Δψ/Δe = k (1 - 2L/(l0 + l1)) while it acts; in a step that passes the
    natural length, the quotient itself.
    """

    k: float
    L: float
    side: int = 0
    stacks: ClassVar[tuple[str, ...]] = ("k", "L")

    def energy(self, e: Array) -> Array:
        stretch = length_of(e) - self.L
        if self.side:
            return self.k * one_sided_energy(self.side * stretch)
        return self.k * stretch**2 / 2

    def average(self, e0: Array, e1: Array) -> tuple[Array, Array]:
        # Lengths l0 and l1 [m] at the start and the end of the step.
        l0 = length_of(e0)
        l1 = length_of(e1)
        mean_length = (l0 + l1) / 2
        if self.side:
            # Stretches y0 and y1 [m], positive where the spring acts.
            y0 = self.side * (l0 - self.L)
            y1 = self.side * (l1 - self.L)
            pull, slope = one_sided_average(y0, y1)
            # The side is ±1, so that the slope has the same sign on both.
            pull = self.side * pull
        else:
            pull = mean_length - self.L
            slope = np.full(pull.shape, 0.5)
        # Δe = mean_length Δl, so that the stress S_mean is the mean force over the mean length.  D
        # is its derivative by e1: d/de1 = d/dl1 / l1, and dmean_length/dl1 = ½.
        S = self.k * pull / mean_length
        D = self.k * (slope - pull / mean_length / 2) / mean_length / l1
        return S[:, None], D[:, None, None]


@dataclass(frozen=True)
class LengthDamper:
    """Axial force c l̇ of the length l = √(2e): S_mean = 2 c (l1 - l0)/(h (l0 + l1))."""

    c: float
    stacks: ClassVar[tuple[str, ...]] = ("c",)

    def average(self, e0: Array, e1: Array, h: float) -> tuple[Array, Array]:
        # Lengths l0 and l1 [m] at the start and the end of the step.
        l0 = length_of(e0)
        l1 = length_of(e1)
        S = 2 * self.c / h * (l1 - l0) / (l0 + l1)
        D = 4 * self.c / h * l0 / (l0 + l1) ** 2 / l1
        return S[:, None], D[:, None, None]


@dataclass(frozen=True)
class RopeDamper:
    """Viscous force f = c ds/dt of a rope of length L, with its stretch s = max(l - L, 0).

    f is not below minus the mean tension k s_mean of the step, so that the rope pulls or is slack.
    With S_mean = 2 f/(l0 + l1) the loss f Δl is never negative.
    """

    c: float
    k: float
    L: float
    stacks: ClassVar[tuple[str, ...]] = ("c", "k", "L")

    def average(self, e0: Array, e1: Array, h: float) -> tuple[Array, Array]:
        # Lengths l0, l1 [m] and stretches s0, s1 [m] at the start and the end of the step; mean
        # tension [N] of the spring and its derivative [N/m] by l1.
        l0 = length_of(e0)
        l1 = length_of(e1)
        both = l0 + l1
        s0 = np.maximum(l0 - self.L, 0.0)
        s1 = np.maximum(l1 - self.L, 0.0)
        pull, slope = one_sided_average(l0 - self.L, l1 - self.L)
        tension = self.k * pull
        stiffness = self.k * slope
        viscous = self.c * (s1 - s0) / h
        # A rope does not push: its whole force, tension and viscous, is zero at the least.
        pulls = viscous > -tension
        # f [N] is the viscous force, df [N/m] its derivative by l1.
        f = np.where(pulls, viscous, -tension)
        viscous_slope = np.where(s1 > 0, self.c / h, 0.0)
        df = np.where(pulls, viscous_slope, -stiffness)
        # The mean length is both/2, and dl1/de1 = 1/l1.  S is S_mean, D its derivative by e1.
        S = 2 * f / both
        D = 2 * (df - f / both) / both / l1
        return S[:, None], D[:, None, None]


# [m²] Lower bound of e = ½ l², so that a spring whose ends coincide has no division by zero.
SMALLEST_MEASURE = 1e-300


def length_of(e: Array) -> Array:
    """Lengths (n,) [m] of the measures e = ½ l² (n, 1) [m²]."""
    return np.sqrt(2 * np.maximum(e[:, 0], SMALLEST_MEASURE))


def half_distance_squared(a: Attached, b: Attached) -> PointMeasure:
    """The measure e = ½|x_a - x_b|² [m²] of two points."""
    difference = np.hstack([np.eye(3), -np.eye(3)])
    return PointMeasure([(a, b)], (difference.T @ difference)[None], np.zeros((1, 6)), np.zeros(1))


@dataclass(frozen=True, eq=False)
class LengthConnector(Between):
    """A stiffness between two points: ψ of `LengthSpring`, by `side` in both directions or one."""

    a: Attached
    b: Attached
    _: KW_ONLY
    stiffness: Stiffness
    length: Length

    # As `LengthSpring.side`.
    side = 0

    def terms(self, start: State) -> Iterable[Term]:
        density = LengthSpring(self.stiffness, self.length, self.side)
        measure = half_distance_squared(self.a, self.b)
        yield PointStoredEnergy(self.name, measure, density, (STIFFNESS, LENGTH))


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Spring(LengthConnector, LineBetween):
    """A linear spring between two points: ψ = ½ k (|x_a - x_b| - L)².

    Args:
        a, b: ports of bodies; one of them may be a `Ground`.
        stiffness: k [N/m], positive.
        length: L [m], at which the spring is at rest; zero or positive.
        name: name in messages and output.

    Raises:
        InputError: two points of the ground, a number out of its range.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> statics = gx.Equilibrium(gx.Scene(weight, spring))
        >>> result = statics.find()
        >>> gx.fields.positions(statics, mass).round(6)
        array([[ 0. ,  0. , -1.1]])
    """

    length: LengthOrZero
    name: str = "spring"


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Rope(LengthConnector, LineBetween):
    """A rope without mass: it holds two points within its length.

    Its tension is k (l - L) where its ends are l > L apart, and zero where they are nearer.

    Args:
        a, b: ports of bodies; one of them may be a `Ground`.
        stiffness: k = EA/L [N/m], positive.
        length: L [m], positive.
        damping: c [N s/m], zero or positive.  The tension of a stretched rope is k (l - L) + c
            dl/dt, but never negative.
        name: name in messages and output.

    Raises:
        InputError: two points of the ground, a number out of its range.

    Example:
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> gx.connectors.Rope(mass.port(), top, stiffness=1e4, length=1.0, damping=0.1).length
        1.0
    """

    damping: DampingOrZero = 0.0
    name: str = "rope"

    side = 1

    def terms(self, start: State) -> Iterable[Term]:
        yield from super().terms(start)
        if self.damping:
            measure = half_distance_squared(self.a, self.b)
            # The damper gets stiffness and length of the rope, by which it keeps the tension of
            # both together from falling below zero.
            loss = RopeDamper(self.damping, self.stiffness, self.length)
            numbers = (STIFFNESS, LENGTH, Parameter("damping", "N s/m", "c"))
            yield PointDissipation(f"{self.name} damping", measure, loss, numbers)


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

    side = -1


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
        yield PointDissipation(
            self.name,
            half_distance_squared(self.a, self.b),
            LengthDamper(self.damping),
            (Parameter("damping", "N s/m", "c"),),
        )


@check_arguments
@dataclass(frozen=True, eq=False)
class AxialSpring:
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
    direction: tuple[float, float, float]
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    name: str = "spring"

    def __post_init__(self) -> None:
        check(
            any(self.direction),
            f"AxialSpring '{self.name}': direction is {self.direction!r}; "
            "give its axis, of any length but zero.",
        )

    def requires(self) -> Iterable[Any]:
        yield self.port.body

    def terms(self, start: State) -> Iterable[Term]:
        n = unit(self.direction)
        # Linear in x: exact for any step, and its matrix is constant.
        rest = -float(n @ np.asarray(self.origin, dtype=float))
        measure = PointMeasure([(self.port,)], np.zeros((1, 3, 3)), n[None], np.array([rest]))
        yield PointStoredEnergy(self.name, measure, Quadratic(self.stiffness), (STIFFNESS,))


@check_arguments
@dataclass(frozen=True, eq=False)
class RopeBundle:
    """Ropes without mass, each as a `Rope`, that are evaluated at once and have one line in the
    ledger.

    Args:
        ends: pairs of ports, or of a port and a `Ground`.
        stiffness: k of each [N/m], positive.
        lengths: L of each [m], positive; as many as pairs.
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

    ends: Sequence[tuple[Attached, Attached]]
    _: KW_ONLY
    stiffness: Stiffness
    lengths: Sequence[Length]
    damping: DampingOrZero = 0.0
    name: str = "ropes"

    def __post_init__(self) -> None:
        check(
            bool(len(self.ends)) and len(self.ends) == len(self.lengths),
            f"RopeBundle '{self.name}' has {len(self.ends)} pairs and {len(self.lengths)} lengths; "
            "give as many of both, and at least one.",
        )
        for k, pair in enumerate(self.ends):
            check(
                bool(list(bodies_of(*pair))),
                f"RopeBundle '{self.name}': rope {k} joins the ground to itself; "
                "give a port of a body.",
            )

    def requires(self) -> Iterable[Any]:
        for pair in self.ends:
            yield from bodies_of(*pair)

    @property
    def lines_to_draw(self) -> Sequence[tuple[Attached, Attached]]:
        """The two ends of each rope."""
        return self.ends

    def terms(self, start: State) -> Iterable[Term]:
        # Terms of one name are summed in the energy balance; those of one kind are one array.
        for k, (pair, length) in enumerate(zip(self.ends, self.lengths, strict=True)):
            measure = half_distance_squared(*pair)
            density = LengthSpring(self.stiffness, float(length), side=1)
            numbers = (STIFFNESS, Parameter("lengths", "m", "L", entry=k))
            yield PointStoredEnergy(self.name, measure, density, numbers)
            if self.damping:
                loss = RopeDamper(self.damping, self.stiffness, float(length))
                of_loss = (*numbers, Parameter("damping", "N s/m", "c"))
                yield PointDissipation(f"{self.name} damping", measure, loss, of_loss)


@check_arguments
@dataclass(frozen=True, eq=False)
class AttachedMass:
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

    port: Port
    mass: Annotated[float, positive("kg")]
    _: KW_ONLY
    name: str = "attached mass"

    def __post_init__(self) -> None:
        # The weights of a direction add up to zero: it would have no mass in translation.
        check(
            bool(np.isclose(translation_weight(self.port), 1.0)),
            f"AttachedMass '{self.name}': its port is not a point of a body; "
            "give one, as film.port('tip').",
        )

    def requires(self) -> Iterable[Any]:
        yield self.port.body

    def terms(self, start: State) -> Iterable[Term]:
        yield AttachedKineticEnergy([(self.port,)], np.full((1, 1, 1), self.mass))
