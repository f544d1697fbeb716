"""The contract: what a scene contains, as seen by what computes it.

A *body* brings coordinates (a `Block`) and an initial state.  A *part* plays one of five roles:

    KineticEnergy      a constant mass matrix
    StoredEnergy       an energy ∫ψ(e(q)) of a quadratic measure e and a density ψ
    Dissipation   a dissipation potential ∫φ(ė) of the rate of a quadratic measure
    Load     a force whose work is booked as supplied
    Support   coordinates that are held, or measures between points that stay zero

The role alone decides how a part is discretised in time and in which column of the ledger it is booked; neither the
stepper nor the ledger knows a part by name.  Parts that live on a mesh speak UFL, parts between points speak NumPy
and see bodies through `Port`s only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeGuard, runtime_checkable

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.common import IndexMap
from mpi4py import MPI

from gossamer_fx.forms.kinematics import Expr
from gossamer_fx.forms.strain_path import Piece

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int32]
Vector = Sequence[float]  # of three numbers


@dataclass(frozen=True)
class Block:
    """Coordinates of one body: `index_map` distributes nodes, each with `size` numbers (a multiple of 3: vectors).

    The vectors of a node are positions (3), or a position and directors (6, 9, 12): linear momentum counts the first.
    """

    index_map: IndexMap
    size: int


class Body(Protocol):
    """Something with coordinates."""

    name: str
    comm: MPI.Intracomm
    block: Block

    def initial_state(self) -> tuple[Array, Array]:
        """Owned coordinates [m] and velocities [m/s], flattened, node by node; not to be written to."""
        ...

    def terms(self) -> Iterable[Term]:
        """The body's own roles."""
        ...

    def describe(self, node: int) -> str:
        """Where an owned node is, in words, for messages."""
        ...


class MeshBody(Body, Protocol):
    """A body discretised on a mesh."""

    space: fem.FunctionSpace


def is_body(item: object) -> TypeGuard[Body]:
    """Whether a scene's item has coordinates."""
    return hasattr(item, "block")


def is_on_mesh(body: Body) -> TypeGuard[MeshBody]:
    """Whether a body is discretised on a mesh."""
    return hasattr(body, "space")


@runtime_checkable
class Stateful(Protocol):
    """Something with a past that the coordinates do not tell; any field of a part may be."""

    def get_state(self) -> dict[str, Any]:
        """Numbers, words and lists of them, the same on every rank."""
        ...

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` returned; coordinates and velocities are those of then."""
        ...


@dataclass(frozen=True, eq=False)
class Port:
    """A vector attached to a body: Σ_k weights[k] q[nodes[k], vectors[k]], a constant linear map of its coordinates.

    `nodes` are global nodes of the body's block; `vectors` says which of a node's vectors is meant: 0 the position
    (the default), 1, 2, ... the directors.  With weights of sum 1 on positions it is a point of the body.
    """

    body: Body
    nodes: tuple[int, ...]
    weights: tuple[float, ...] = (1.0,)
    vectors: tuple[int, ...] = ()


@dataclass(frozen=True)
class Ground:
    """A vector that stays what it is: a point [m] or a direction of inertial space."""

    vector: tuple[float, float, float]


Attached = Port | Ground


@dataclass(frozen=True, eq=False)
class KineticEnergy:
    """Kinetic energy ½ v·Mv with the constant mass matrix `mass(v, w)`, a bilinear form."""

    body: MeshBody
    mass: Callable[[Expr, Expr], ufl.Form]


@dataclass(frozen=True, eq=False)
class NodeKineticEnergy:
    """Kinetic energy ½ Σ_ij mass[i, j] v_i·v_j of a body without mesh, v_i the rates of a node's vectors.

    `mass` (n, s, s) for the n owned nodes of s vectors: kg for positions, kg m and kg m² with directors.
    """

    body: Body
    mass: Array


@dataclass(frozen=True, eq=False)
class StoredEnergy:
    """Stored energy ∫ψ(e(q)) dx: `measure` is quadratic in q, `density` ψ knows the strain only.

    `pieces` cuts the path between two strains where ψ is not smooth.
    """

    name: str
    body: MeshBody
    measure: Callable[[Expr], Expr]
    density: Callable[[Expr], Expr]
    dx: ufl.Measure
    quadratic: bool = False
    pieces: Callable[[Expr, Expr], list[Piece]] | None = None


@dataclass(frozen=True, eq=False)
class Dissipation:
    """Dissipation: stress φ'(ė) against the rate of the measure; φ is quadratic and convex, the loss 2∫∫φ(ė) dx dt."""

    name: str
    body: MeshBody
    measure: Callable[[Expr], Expr]
    density: Callable[[Expr], Expr]
    dx: ufl.Measure


@dataclass(frozen=True, eq=False)
class AttachedKineticEnergy:
    """Kinetic energy ½ Σ_ij mass[i, j] v_i·v_j of the rates v of attached vectors, at n places.

    places: n tuples of k ports, as those of a `PointMeasure`; mass (n, k, k) [kg].
    """

    places: Sequence[tuple[Port, ...]]
    mass: Array


@dataclass(frozen=True, eq=False)
class PointMeasure:
    """Quadratic measures e_i = ½ X·H_i X + L_i·X + c_i of stacked attached vectors X (3k,): the same at n places.

    places: n tuples of k vectors, not all of them `Ground`; a place is evaluated on the rank of its first port, and
        each rank may list all places, or its own only.
    H (m, 3k, 3k) symmetric, L (m, 3k), c (m,), or (n, m) where the places differ
    """

    places: Sequence[tuple[Attached, ...]]
    H: Array
    L: Array
    c: Array


class PointDensity(Protocol):
    """Energy of the m strains e of a point measure; all arguments and results are arrays over n places."""

    def energy(self, e: Array) -> Array:
        """ψ(e) [J], (n,) of (n, m)."""
        ...

    def average(self, e0: Array, e1: Array) -> tuple[Array, Array]:
        """S̄ (n, m) and dS̄/de1 (n, m, m) with S̄·(e1 - e0) = ψ(e1) - ψ(e0); at e0 = e1 they are (ψ', ψ''/2)."""
        ...


class PointDamping(Protocol):
    """Stress against the rate of the m strains of a point measure, never with negative loss."""

    def average(self, e0: Array, e1: Array, h: float) -> tuple[Array, Array]:
        """S̄ (n, m) and dS̄/de1 (n, m, m) with S̄·(e1 - e0) ≥ 0, the loss in a step of h seconds."""
        ...


@dataclass(frozen=True, eq=False)
class PointStoredEnergy:
    """Stored energy ψ(e) of a point measure."""

    name: str
    measure: PointMeasure
    density: PointDensity


@dataclass(frozen=True, eq=False)
class PointDissipation:
    """Dissipation by the rate of a point measure."""

    name: str
    measure: PointMeasure
    density: PointDamping


@dataclass(frozen=True, eq=False)
class PointConstraint:
    """Measures that stay zero, by multipliers λ: e(q1) = 0 at the end of a step, force De(q̄)ᵀλ in it.

    De(q̄)(q1 - q0) = e(q1) - e(q0) = 0: the force does no work, and conserves what e is invariant to.
    """

    name: str
    measure: PointMeasure


class PointForce(Protocol):
    """Force on attached vectors, evaluated alike on every rank."""

    def begin(self, t: float, lag: float, X: Array, V: Array) -> None:
        """Start a step at time t from the vectors X (3k,) and their rates V; forces act `lag` seconds later."""
        ...

    def force(self, X: Array) -> Array:
        """Forces (3k,) at the configuration X (3k,) in which forces act."""
        ...

    def tangent(self, X: Array) -> Array:
        """Their derivatives (3k, 3k)."""
        ...


@dataclass(frozen=True, eq=False)
class PointLoad:
    """A load on attached vectors; its work is booked as supplied."""

    name: str
    ports: tuple[Attached, ...]
    law: PointForce


@dataclass(frozen=True, eq=False)
class Load:
    """A load: `work(q, w)` is its virtual work, linear in w; `at(t)`, if given, sets its constants to time t."""

    name: str
    body: MeshBody
    work: Callable[[Expr, Expr], ufl.Form]
    follows: bool = False  # whether the work form depends on the configuration q
    at: Callable[[float], None] | None = None


@dataclass(frozen=True, eq=False)
class Support:
    """Coordinates that keep their initial values, or take the values `motion(t)` [m], (n,) like `dofs`.

    `dofs` are owned and ghost scalar indices of the body's block.
    """

    name: str
    body: MeshBody
    dofs: Indices
    motion: Callable[[float], Array] | None = None


Term = (
    KineticEnergy
    | NodeKineticEnergy
    | AttachedKineticEnergy
    | StoredEnergy
    | Dissipation
    | Load
    | Support
    | PointStoredEnergy
    | PointDissipation
    | PointLoad
    | PointConstraint
)
