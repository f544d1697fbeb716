"""Contact pairs: their distances, energies, forces and tangents.

A pair is three vectors, linear in its four points: r between the two sides, a and b along them.  Its squared distance

    s(e) = min over (u, v) of φ(u, v)·e,   e = (r·r, r·a, r·b, a·a, a·b, b·b),   φ = (1, 2u, 2v, u², 2uv, v²)

is a concave function of six quadratic measures e.  An energy k b(x), x = (s - offset)/S, of a falling convex b is then
convex in e, and is discretised as every other stored energy:

    S̄ = k (b(x1) - b(x0))/(s1 - s0) φ̄,   φ̄ = ∫₀¹ φ dτ along e0 + τ Δe,   Δe = e1 - e0

by two Gauss points, and what is missing of φ̄·Δe = s1 - s0 is added along Δe.  Force De(q̄)ᵀ S̄.  Where edges may be
parallel, s is rounded by adding ε ((u - ½)² + (v - ½)²) to |r + u a + v b|²: it stays concave and becomes smooth.
Where edges cross, s is at most ε/2 then: that much is added to the offset of barriers, which are infinite there.  Edges
must keep a fiftieth of their x in a step; in iterates that do not, b goes on as a parabola.
r leads to the nearest points of the start, so that small distances of large triangles keep their digits.

    law         b(x), zero for x ≥ 1
    BARRIER     (1 - x)³/(4x): nothing gets through, whatever its stiffness
    PENALTY     (1 - √x)²/2: linear in the distance

Where the distance itself, or that from the middle of a ball or cylinder, is a measure, the penalty is (1 - x)²/2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gossamer_fx.contact.kernels.library import Array, Bytes, Integers, library, pointers

BARRIER, PENALTY = 0, 1
POINT_TRIANGLE, EDGE_EDGE, PLANE, IN_SPHERE, IN_CYLINDER = range(5)
ROUNDING = 0.05  # ε over S
PUSH = (
    4.0  # stiffness by which iterates that passed through are pushed back, over that of their pair
)
NONE, TOUCHES, PASSED = range(3)  # what a pair does in a step


@dataclass
class ContactPairs:
    """n pairs: nodes (n, 4), kind (n,), stiffness k [J], threshold S and offset of s; names (n,) tell them apart.

    S and offset are squared lengths; of planes they are lengths.
    """

    nodes: Integers
    kind: Bytes
    k: Array
    S: Array
    offset: Array
    names: np.ndarray

    def __len__(self) -> int:
        return len(self.kind)

    def some(self, which: np.ndarray) -> ContactPairs:
        """Those of the given indices, or where a mask is true."""
        return ContactPairs(
            *(getattr(self, name)[which] for name in ("nodes", "kind", "k", "S", "offset", "names"))
        )


@dataclass
class PairResponse:
    """What pairs do: state (n,) NONE, TOUCHES or PASSED; forces (n, 12) [N]; tangents (n, 144) [N/m] if asked for."""

    state: Bytes
    forces: Array | None
    tangents: Array | None


def infinite_at_crossings(kind: Bytes, S: Array, offset: Array) -> tuple[Array, Array]:
    """S and offset (n,) with which a barrier begins where it did, and is infinite where rounded edges cross."""
    rounded = np.where(kind == EDGE_EDGE, ROUNDING / 2, 0.0)
    S = S / (1 + rounded)
    return S, offset + rounded * S


def squared_distances(nodes: Integers, kind: Bytes, x: Array) -> Array:
    """s (n,) [m²], without rounding, of points x (m, 3); of planes the signed distance [m]."""
    s = np.empty(len(kind))
    library().lib.squared_distances(
        len(kind), *pointers(nodes), *pointers(kind), *pointers(x), *pointers(s), *pointers(None)
    )
    return s


def nearest_points(nodes: Integers, kind: Bytes, x: Array) -> Array:
    """(u, v) (n, 2) of the nearest points of pairs of triangles and edges."""
    s, uv = np.empty(len(kind)), np.empty((len(kind), 2))
    library().lib.squared_distances(
        len(kind), *pointers(nodes), *pointers(kind), *pointers(x), *pointers(s), *pointers(uv)
    )
    return uv


def starts(pairs: ContactPairs, x0: Array) -> Array:
    """What `act` needs to know of pairs at x0: (u, v) of the nearest points, distance [m] and s [m²] (n, 4)."""
    start = np.empty((len(pairs), 4))
    library().lib.starts(
        len(pairs), *pointers(pairs.nodes, pairs.kind, x0, pairs.S), ROUNDING, *pointers(start)
    )
    return start


def approaches(
    nodes: Integers, kind: Bytes, x0: Array, x1: Array, margin: Array | None = None
) -> Array:
    """By how much (n,) [m] pairs may come nearer on the straight way from x0 to x1; of walls infinite.

    margin: distances (m,) [m] within which points may end beside x1.
    """
    way = np.empty(len(kind))
    library().lib.approaches(len(kind), *pointers(nodes, kind, x0, x1, margin, way))
    return way


def energy(pairs: ContactPairs, x: Array, law: int) -> tuple[float, Array]:
    """Energy [J] of pairs in a state, and x (n,) of each, below one where they touch."""
    X = np.empty(len(pairs))
    total = library().lib.energy(
        len(pairs),
        *pointers(pairs.nodes, pairs.kind, x, pairs.k, pairs.S, pairs.offset),
        ROUNDING,
        law,
        *pointers(X),
    )
    return float(total), X


def act(
    pairs: ContactPairs,
    x0: Array,
    x1: Array,
    law: int,
    alpha: float,
    *,
    force: Array | None = None,
    slots: Integers | None = None,
    values: Array | None = None,
    geometric: float = 1.0,
    each: bool = False,
    tangents: bool = False,
    start: Array | None = None,
    state: Bytes | None = None,
) -> PairResponse:
    """Forces and tangents of a step from points x0 to x1 (m, 3), or in the state x1 if α = 1.

    Args:
        force: (m, 3), to which forces are added.
        slots, values: (n, 16) and (blocks, 9), to which the tangents' blocks of 3 x 3 are added.
        geometric: share of the geometric stiffness α S̄·D²e in tangents; it is what is not positive in them.
        each: whether forces are also given pair by pair, and with `tangents` the tangents.
        start: of `starts` at x0, which saves time.
        state: of the same step, if it is known from an earlier call.
    """
    n, again = len(pairs), state is not None
    state = np.empty(n, dtype=np.uint8) if state is None else state
    forces = np.empty((n, 12)) if each else None
    stiffness = np.empty((n, 144)) if each and tangents else None
    library().lib.act(
        n,
        *pointers(pairs.nodes, pairs.kind, x0, x1, pairs.k, pairs.S, pairs.offset, start),
        ROUNDING,
        law,
        alpha,
        geometric,
        PUSH,
        again,
        *pointers(state, force, slots, values, forces, stiffness),
    )
    return PairResponse(state, forces, stiffness)
