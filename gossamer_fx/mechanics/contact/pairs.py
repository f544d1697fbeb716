"""Contact pairs: their kinds, the tables in which they stand, their closest points and gaps.

A pair is two primitives that may touch: a point and a triangle, two edges, or a point and a
boundary.

Kinds.  The *stencil* of a kind has all that is different from one kind to the next.  A kind is a
row of `kernels/stencils.c` and the class here that has its number: together they say what the
distance is, its derivatives, the range of the energy, and whether a point may get behind the other
side.  Everything else asks the stencil.  A new kind is a new class, wherever it is written, and a
row in C: see `cone.py`.  A boundary whose distance is a plain function needs no C: `LawBoundary`.

Tables.  The stages of contact hand on a table with one row a pair.  It is a structure of arrays,
since the C functions and NumPy work on columns.  The broad phase makes `CandidatePairs`, of which
the active set makes `ActivePairs` with the columns of the energy.

Distances.  The C functions give a number s for each pair, in which the energy is concave
(`contact.contact_step`):

    two surfaces       s is the squared distance of the closest points [m²], which have the
                       parameters (u, v) on the two sides
    planes             s is the signed distance [m]
    inside of a room   s is minus the squared distance from its middle [m²]

`PairStencil.distance` makes metres of it; the `gap` of a pair is its distance [m] less the radii of
both sides.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.errors import InputError
from gossamer_fx.core.forms.c_source import CStruct, check_indices
from gossamer_fx.core.laws.tracing import Number
from gossamer_fx.mechanics.contact.contract import (
    Array,
    ByteArray,
    Int32Array,
    Int64Array,
    MaskArray,
    Sides,
)
from gossamer_fx.mechanics.contact.kernels.library import library

if TYPE_CHECKING:
    from gossamer_fx.core.laws.law import Law

# ---- kinds ----


# ε over the width of a pair of edges.  With a fiftieth of it, barriers near the ends of edges are
# so steep that a fine sail needs 40 % more steps.
ROUNDING = 0.05

# No length: divisions by smaller ones are meaningless.
TINY = 1e-300


class PairStencil:
    """A kind of pair; each subclass with a number is one.

    Its methods take n pairs of this kind:

        s           what the C functions call the squared distance (n,), see the module
        radius      of both sides together (n,) [m]
        shape       the number (n,) that the kind needs besides points; zero if it needs none
        reach       activation distance (n,) [m], the gap below which pairs have energy
        x           the four points of each pair (n, 4, 3) [m], of which directions are vectors [-];
                    complex ones are differentiated by a complex step
        parameters  (u, v) (n, 2) [-] of the closest points along both sides; of boundaries zero
    """

    number: ClassVar[int]
    sides: ClassVar[Sides]

    def __init_subclass__(cls) -> None:
        """Enter a kind with a number into `STENCILS` and `SIDES`."""
        if "number" in vars(cls):
            taken = STENCILS.get(cls.number)
            if taken is not None:
                raise TypeError(f"{cls.__name__}: {type(taken).__name__} is number {cls.number}.")
            STENCILS[cls.number] = cls()
            SIDES[cls.number] = cls.sides

    @classmethod
    def prepare(cls, comm: MPI.Intracomm) -> None:
        """Compile what the kind needs beyond the C functions of contact, before there are pairs of
        it.  Collective."""

    def distance(self, s: Array) -> Array:
        """Return the distance (n,) [m] of both sides without radii; in rooms it is negative."""
        return np.sqrt(np.maximum(s, 0))

    def gap(self, s: Array, radius: Array, shape: Array) -> Array:
        """Return the distance (n,) [m] less the radii of both sides."""
        return self.distance(s) - radius

    def energy_range(
        self, reach: Array, radius: Array, shape: Array, is_barrier: bool
    ) -> tuple[Array, Array]:
        """Return width and offset (n,) of x = (s - offset)/width, in the unit of s. x is zero where
        the sides meet, and one where the gap is the activation distance."""
        # With the sum R of both radii, a pair with the gap d has the squared distance (R + d)².
        width: Array = (radius + reach) ** 2 - radius**2
        return width, radius**2

    def gap_weights(self, parameters: Array) -> Array:
        """Return the weights (n, 4) of the points in the vector from the second side to the first.
        It leads between the closest points; of boundaries it is the first point."""
        raise NotImplementedError

    def derivatives(self, x: Array, parameters: Array, shape: Array) -> tuple[Array, Array]:
        """Return the distance D (n,) [m] and its derivatives (n, 4, 3) by the points. That by the
        first point of a boundary's pair is the unit normal, towards the body."""
        # Closest points are stationary, so that their parameters count as constant.
        weights = self.gap_weights(parameters)
        between = np.einsum("nk,nkc->nc", weights, x)
        distance = lengths_of(between)
        direction = between / np.maximum(distance, TINY)[:, None]
        return distance, weights[:, :, None] * direction[:, None]

    def taper(self, shape: Array) -> Array | None:
        """Return T (n,) [m] if closest points minimise |z| - T v, z being the vector between the
        points (u, v) of both sides; None: they minimise |z|."""
        return None

    def parameter_derivatives(self, x: Array, parameters: Array, shape: Array) -> Array:
        """Return the derivatives (n, 2, 4, 3) [1/m] of (u, v) by the points; zero for
        boundaries."""
        from gossamer_fx.mechanics.contact.narrow_phase.closest_point_derivatives import (
            parameter_derivatives,
        )

        return parameter_derivatives(self.sides, x, parameters, self.taper(shape))


# Arguments of the law of a boundary by which it is derived.
PRODUCTS = ("rr", "ra", "rb", "aa", "ab", "bb")

# The stencil of each kind, and its sides, by the number of the kind.
STENCILS: dict[int, PairStencil] = {}
SIDES = np.zeros(256, dtype=np.uint8)


class PointTriangle(PairStencil):
    """A point and a triangle."""

    number = 0
    sides = Sides.POINT_TRIANGLE

    def gap_weights(self, parameters: Array) -> Array:
        u, v = parameters.T
        return np.column_stack([np.ones_like(u), u + v - 1, -u, -v])


class EdgeEdge(PairStencil):
    """Two edges, whose squared distance is rounded where they are almost parallel."""

    number = 1
    sides = Sides.EDGE_EDGE

    def gap_weights(self, parameters: Array) -> Array:
        u, v = parameters.T
        return np.column_stack([1 - u, u, v - 1, -v])

    def energy_range(
        self, reach: Array, radius: Array, shape: Array, is_barrier: bool
    ) -> tuple[Array, Array]:
        width, offset = super().energy_range(reach, radius, shape, is_barrier)
        if not is_barrier:
            return width, offset
        # Squared distances of edges are rounded, so that they are not zero at a crossing.  Barriers
        # shall be infinite there, and begin at the same distance: offset + width is constant.
        width = width / (1 + ROUNDING / 2)
        return width, offset + ROUNDING / 2 * width


class BoundaryStencil(PairStencil):
    """A point and a boundary, behind which it cannot get."""

    sides = Sides.POINT_BOUNDARY

    def gap_weights(self, parameters: Array) -> Array:
        return np.broadcast_to([1.0, 0.0, 0.0, 0.0], (len(parameters), 4))

    def parameter_derivatives(self, x: Array, parameters: Array, shape: Array) -> Array:
        return np.zeros((len(x), 2, 4, 3), dtype=x.dtype)


class PointPlane(BoundaryStencil):
    """A point and a plane, whose first direction is its unit normal; its second one is not used,
    and s is the distance [m]."""

    number = 2

    def distance(self, s: Array) -> Array:
        return s

    def energy_range(
        self, reach: Array, radius: Array, shape: Array, is_barrier: bool
    ) -> tuple[Array, Array]:
        return reach, radius

    def derivatives(self, x: Array, parameters: Array, shape: Array) -> tuple[Array, Array]:
        r = x[:, 0] - x[:, 1]
        normal = x[:, 2]
        gradient = np.zeros_like(x)
        gradient[:, 0] = normal
        gradient[:, 1] = -normal
        gradient[:, 2] = r
        return (r * normal).sum(axis=1), gradient


class Room(BoundaryStencil):
    """A point within a round room, whose radius [m] is its `shape`."""

    def distance(self, s: Array) -> Array:
        length: Array = np.sqrt(np.maximum(-s, 0))
        return -length

    def gap(self, s: Array, radius: Array, shape: Array) -> Array:
        return (shape - radius) + self.distance(s)

    def energy_range(
        self, reach: Array, radius: Array, shape: Array, is_barrier: bool
    ) -> tuple[Array, Array]:
        room = shape - radius
        return room**2 - (room - reach) ** 2, -(room**2)


class PointInSphere(Room):
    """A point in a sphere, whose origin is the centre, and which has no directions."""

    number = 3

    def derivatives(self, x: Array, parameters: Array, shape: Array) -> tuple[Array, Array]:
        r = x[:, 0] - x[:, 1]
        distance = lengths_of(r)
        gradient = np.zeros_like(x)
        gradient[:, 0] = -r / np.maximum(distance, TINY)[:, None]
        gradient[:, 1] = -gradient[:, 0]
        return -distance, gradient


class PointInCylinder(Room):
    """A point in a cylinder, whose directions are two unit vectors across its axis."""

    number = 4

    def derivatives(self, x: Array, parameters: Array, shape: Array) -> tuple[Array, Array]:
        r = x[:, 0] - x[:, 1]
        across = np.einsum("nc,nkc->nk", r, x[:, 2:])
        distance = lengths_of(across)
        share = across / np.maximum(distance, TINY)[:, None]
        gradient = np.zeros_like(x)
        gradient[:, 0] = -np.einsum("nk,nkc->nc", share, x[:, 2:])
        gradient[:, 1] = -gradient[:, 0]
        gradient[:, 2:] = -share[:, :, None] * r[:, None]
        return -distance, gradient


# Numbers of kinds whose distance is a law: kinds are bytes, and lower numbers are rows in C.
NUMBERS_OF_LAWS = range(128, 256)


class LawBoundary(BoundaryStencil):
    """Base of boundaries whose distance is a law of the point: a subclass gives `law`, which is
    compiled with its derivatives.

    With the point's vector r from the origin of the boundary and its two directions a and b, which
    turn with the obstacle and may have any length, `law(rr, ra, rb, aa, ab, bb, shape)` returns the
    distance [m] from the boundary as a function of the products r·r, r·a, ... and of the number
    that the boundary has as its `shape`.  It is positive on the side where bodies are, has a slope
    of one across the boundary, and is smooth there.  As of all laws (`core.laws`) it may compare
    and use NumPy's functions of one number.

    Energy is conserved for every law.  Newton's method needs fewest iterations where the distance
    is a concave function of the products, as those of rooms are.

    Example:
        >>> import numpy as np
        >>> class InTube(LawBoundary):
        ...     @staticmethod
        ...     def law(rr, ra, rb, aa, ab, bb, shape):
        ...         return shape - np.sqrt(rr - ra * ra)
        >>> InTube.number >= 128
        True
    """

    _compiled: ClassVar[Law]

    @staticmethod
    def law(
        rr: Number, ra: Number, rb: Number, aa: Number, ab: Number, bb: Number, shape: Number
    ) -> Number:
        """Return the distance [m] from the boundary."""
        raise NotImplementedError

    def __init_subclass__(cls) -> None:
        """Give the kind the next number."""
        free = [number for number in NUMBERS_OF_LAWS if number not in STENCILS]
        if not free:
            raise InputError(
                f"{cls.__name__}: there are {len(NUMBERS_OF_LAWS)} classes of boundaries with a "
                "law already; give the number that differs as their shape."
            )
        cls.number = free[0]
        super().__init_subclass__()

    @classmethod
    def prepare(cls, comm: MPI.Intracomm) -> None:
        from gossamer_fx.core.laws.law import compile_law

        cls._compiled = compile_law(cls.law, by=PRODUCTS, orders=2, comm=comm)
        library().lib.set_boundary_law(cls.number, cls._compiled.address)

    def distance(self, s: Array) -> Array:
        return s

    def energy_range(
        self, reach: Array, radius: Array, shape: Array, is_barrier: bool
    ) -> tuple[Array, Array]:
        return reach, radius

    def derivatives(self, x: Array, parameters: Array, shape: Array) -> tuple[Array, Array]:
        r, a, b = x[:, 0] - x[:, 1], x[:, 2], x[:, 3]
        both = ((r, r), (r, a), (r, b), (a, a), (a, b), (b, b))
        e = np.stack([(p * q).sum(axis=1) for p, q in both])
        s = np.empty(len(x), dtype=x.dtype)
        slopes = np.empty((len(x), 6), dtype=x.dtype)
        for i, (products, number) in enumerate(zip(e.T, shape, strict=True)):
            value, first, second = self._compiled(*products.real.tolist(), float(number))
            # To first order in the imaginary parts, which is what complex steps need.
            s[i], slopes[i] = value[0], first[0]
            if np.iscomplexobj(x):
                s[i] += 1j * first[0] @ products.imag
                slopes[i] += 1j * second[0] @ products.imag
        of_rr, of_ra, of_rb, of_aa, of_ab, of_bb = slopes.T[:, :, None]
        gradient = np.zeros_like(x)
        gradient[:, 0] = 2 * of_rr * r + of_ra * a + of_rb * b
        gradient[:, 1] = -gradient[:, 0]
        gradient[:, 2] = of_ra * r + 2 * of_aa * a + of_ab * b
        gradient[:, 3] = of_rb * r + of_ab * a + 2 * of_bb * b
        return s, gradient


def stencils_of(kind: ByteArray) -> Iterator[tuple[PairStencil, Any]]:
    """Yield each stencil among pairs of the kinds (n,), and its rows as a mask, or a slice of
    all."""
    present = np.bincount(kind).nonzero()[0]
    if len(present) == 1:
        # The usual scene of boundaries, or a table of one kind, is not copied.
        yield STENCILS[int(present[0])], slice(None)
        return
    for number in present:
        yield STENCILS[int(number)], kind == number


def is_boundary(kind: ByteArray) -> MaskArray:
    """Return which pairs (n,) are of a point and a boundary: a plane, or the inside of a room."""
    return np.asarray(SIDES[kind] == Sides.POINT_BOUNDARY)


def gaps_of(pairs: PairTable, s: Array, radius: Array) -> Array:
    """Return the gaps (n,) [m] of pairs: their distance less the radii of both sides (n,) [m]."""
    gap = np.empty(len(pairs))
    for stencil, rows in stencils_of(pairs.kind):
        gap[rows] = stencil.gap(s[rows], radius[rows], pairs.shapes[rows])
    return gap


def gap_weights_of(kind: ByteArray, parameters: Array) -> Array:
    """Return the weights (n, 4) of pairs' points in the vector from their second side to the first.
    It leads between the closest points, which have the parameters (u, v) (n, 2); of boundaries it
    is the first point."""
    weights = np.empty((len(kind), 4), dtype=parameters.dtype)
    for stencil, rows in stencils_of(kind):
        weights[rows] = stencil.gap_weights(parameters[rows])
    return weights


def derivatives_of(pairs: PairTable, x: Array, parameters: Array) -> tuple[Array, Array]:
    """Return the distances (n,) [m] of pairs, and their derivatives (n, 4, 3) by their points x."""
    distance = np.empty(len(pairs), dtype=x.dtype)
    gradient = np.empty_like(x)
    for stencil, rows in stencils_of(pairs.kind):
        distance[rows], gradient[rows] = stencil.derivatives(
            x[rows], parameters[rows], pairs.shapes[rows]
        )
    return distance, gradient


def parameter_derivatives_of(pairs: PairTable, x: Array, parameters: Array) -> Array:
    """Return the derivatives (n, 2, 4, 3) [1/m] of (u, v) of pairs by their points x (n, 4, 3)."""
    found = np.empty((len(pairs), 2, 4, 3))
    for stencil, rows in stencils_of(pairs.kind):
        found[rows] = stencil.parameter_derivatives(x[rows], parameters[rows], pairs.shapes[rows])
    return found


# ---- vectors, also complex ones ----


def lengths_of(vectors: Array) -> Array:
    """Return the lengths (...) of vectors (..., k). Of complex vectors it is the analytic function
    of them, and not the norm: a complex step differentiates it."""
    return np.sqrt((vectors * vectors).sum(axis=-1))


# ---- tables ----


class PairRows:
    """Base of dataclasses whose fields are arrays with a row for each of n pairs."""

    def rows(self, which: Any) -> Self:
        """Return a table of some rows, given by indices or by a mask (n,)."""
        columns: dict[str, Any] = {}
        for column in fields(cast(Any, self)):
            values = getattr(self, column.name)
            # A column that no kind needs is absent.
            columns[column.name] = None if values is None else values[which]
        return type(self)(**columns)


@dataclass(frozen=True, eq=False)
class PairTable(PairRows):
    """n pairs of this rank: what their distances need.

    Attributes:
        kind: of each pair (n,), the number of its stencil.
        points: numbers (n, 4) of its points in the contact.
        shape: number (n,) that the stencil needs, such as the radius of a room [m]; None: zeros.
    """

    kind: ByteArray
    points: Int32Array
    shape: Array | None = field(default=None, kw_only=True)

    def __len__(self) -> int:
        return len(self.kind)

    def followed_by(self, other: Self) -> Self:
        """Return a table of these rows and those of another one that has the same columns."""
        columns = {}
        for column in fields(self):
            both = (getattr(self, column.name), getattr(other, column.name))
            columns[column.name] = np.concatenate(both)
        return type(self)(**columns)

    def check(self, point_count: int) -> None:
        """Raise `ValueError` if a pair has a point or kind that does not exist: C does not look."""
        check_indices("The points of pairs", self.points, point_count)
        check_indices("The kinds of pairs", self.kind, max(STENCILS) + 1)

    def geometry(self, which: Any) -> PairTable:
        """Return what the distances of some rows need, without the columns of a subclass."""
        shape = None if self.shape is None else self.shape[which]
        return PairTable(self.kind[which], self.points[which], shape=shape)

    @property
    def shapes(self) -> Array:
        """The numbers (n,) that stencils need."""
        return np.zeros(len(self)) if self.shape is None else self.shape

    @property
    def second_point(self) -> Int32Array:
        """The first point (n,) of the second side."""
        # The second side begins behind one point, or behind the two ends of an edge.
        is_edges = SIDES[self.kind] == Sides.EDGE_EDGE
        return np.where(is_edges, self.points[:, 2], self.points[:, 1])


@dataclass(frozen=True, eq=False)
class CandidatePairs(PairTable):
    """Pairs that may come near in the next steps.

    Attributes:
        identifier: numbers (n,) that are the same on every rank and in every search, by which
            history variables find their pair again; see `CollisionMesh.identifiers`.
        area: for which each pair stands [m²] (n,).
        radius: of both sides together [m] (n,), for cables, beams and round obstacles.
    """

    identifier: Int64Array
    area: Array
    radius: Array


@dataclass(frozen=True, eq=False)
class ActivePairs(PairTable):
    """Pairs that may have energy k b(x) in a step, x = (s - offset)/width of the squared distance
    s.

    Attributes:
        identifier: as those of candidates (n,).
        stiffness: k [J] (n,).
        width: change of s over which the energy falls to zero (n,), in the unit of s: [m²] or [m].
        offset: s at which x is zero (n,).
    """

    identifier: Int64Array
    stiffness: Array
    width: Array
    offset: Array


@dataclass(frozen=True, eq=False)
class StepPairs(ActivePairs):
    """Active pairs with what their energy rule needs from the start of a step; see
    `contact_step.begin_at`.

    Attributes:
        start: parameters u, v of the closest points, distance [m], and s with rounded edges (n, 4).
    """

    start: Array

    @property
    def parameters(self) -> Array:
        """(u, v) (n, 2) [-] of the closest points at the start."""
        return self.start[:, :2]


def pair_list_fields(pairs: PairTable) -> dict[str, Any]:
    """Return the fields of a `pair_list`, which other structures hold, too."""
    c = library()
    count = len(pairs)
    return {
        "count": count,
        "points": c.array("points", pairs.points, "int32", (count, 4)),
        "kind": c.array("kind", pairs.kind, "uint8", (count,)),
        "shape": c.array("shape", pairs.shape, "float64", (count,)),
    }


def pair_list(pairs: PairTable) -> CStruct:
    """Return what distances of pairs need as a `pair_list`."""
    return library().struct("pair_list", pair_list_fields(pairs))


# ---- closest points and gaps ----

# Pairs whose gaps are computed at once: of all pairs at once the temporary arrays take more memory
# than what is kept.
PAIRS_AT_ONCE = 2**16


def closest_points(pairs: PairTable, x: Array) -> tuple[Array, Array]:
    """Return the squared distances s (n,) [m²] of contact pairs at points x (m, 3) [m], and the
    parameters (u, v) (n, 2) [-] of their closest points.

    Of boundaries s is what the module says.  The closest points of two edges are at u and v of
    their lengths; the one on a triangle is corner 0 + u (corner 1 - corner 0) + v (corner 2 -
    corner 0).  Boundaries have no parameters: zeros.
    """
    c = library()
    count = len(pairs)
    squared_distance = np.empty(count)
    parameters = np.empty((count, 2))
    c.lib.closest_points(
        pair_list(pairs).pointer,
        c.array("x", x, "float64", (len(x), 3)),
        c.array("squared_distance", squared_distance, "float64", (count,), writable=True),
        c.array("parameters", parameters, "float64", (count, 2), writable=True),
    )
    return squared_distance, parameters


def approach_bounds(pairs: PairTable, x0: Array, x1: Array) -> Array:
    """Return by how much (n,) [m] contact pairs can come closer at most while their points move
    straight from x0 to x1 (m, 3) [m]; infinite for boundaries."""
    # The compiled C library of contact, which checks the arrays that it gets
    c = library()
    points = len(x0)
    bound = np.empty(len(pairs))
    c.lib.approach_bounds(
        pair_list(pairs).pointer,
        c.array("x0", x0, "float64", (points, 3)),
        c.array("x1", x1, "float64", (points, 3)),
        c.array("bound", bound, "float64", (len(pairs),), writable=True),
    )
    return bound


class PairDistances:
    """Gaps of all candidates at one set of points x (m, 3).

    Far pairs need no closest points: their gap may be a lower bound that follows from an earlier
    state.  Closest points are computed for those that ask for them, and not kept: in packed layers
    less than one candidate in forty takes part in a step.

    Attributes:
        candidates: the n pairs.
        x: the points (m, 3) [m].
        gap: gaps (n,) [m], exact for those that were computed at first, else lower bounds.
    """

    def __init__(self, candidates: CandidatePairs, x: Array, lower_bound: Array) -> None:
        """Start with lower bounds of the gaps; `make_exact` replaces some of them. `lower_bound`:
        of each gap (n,) [m]; the array becomes `gap` and is changed in place."""
        self.candidates = candidates
        self.x = x
        self.gap = lower_bound

    @classmethod
    def of(cls, candidates: CandidatePairs, x: Array) -> PairDistances:
        """Compute all gaps at points x."""
        found = cls(candidates, x, np.empty(len(candidates)))
        found.make_exact()
        return found

    def make_exact(self, rows: Int64Array | None = None) -> None:
        """Replace the lower bounds of the gaps [m] of some pairs, by default of all, by the gaps;
        `rows`: indices (k,)."""
        count = len(self.candidates) if rows is None else len(rows)
        for first in range(0, count, PAIRS_AT_ONCE):
            some: Any = slice(first, first + PAIRS_AT_ONCE)
            if rows is not None:
                some = rows[some]
            geometry = self.candidates.geometry(some)
            squared_distance, _ = closest_points(geometry, self.x)
            self.gap[some] = gaps_of(geometry, squared_distance, self.candidates.radius[some])

    def closest_points(self, rows: MaskArray) -> tuple[Array, Array]:
        """Return squared distances s (k,) and parameters (k, 2) of the closest points of some pairs
        (mask (n,)), as the function of this name."""
        return closest_points(self.candidates.geometry(rows), self.x)
