"""The contract: bodies, and the terms that the parts of a scene add to its equations.

A *body* brings coordinates (a `Block`) and an initial state.  A *term* plays one of five roles:

    kinetic energy   a constant mass matrix
    stored energy    ψ(e(q)) of a measure e that rigid motions leave as it is, and a density ψ
    dissipation      a stress against the rate of a measure
    load             a force whose work is booked as supplied
    constraint       coordinates that are held, or measures that stay zero

The kinds of terms are in `terms/`: each names the class that compiles all terms of its kind, a `CompiledTerms`.
Neither the system, the steppers nor the ledger know a kind by name, so a new one is a new file.  Terms on a mesh speak
UFL; terms between points speak NumPy and see bodies through `Port`s only.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any, ClassVar, Protocol, TypeGuard, runtime_checkable

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.common import IndexMap
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.checks.arguments import Count, check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.drawing.solids import Solid

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int32]
Vector = Annotated[Sequence[float], Count(3)]


@dataclass(frozen=True)
class Block:
    """Coordinates of one body: `index_map` distributes nodes, each with `size` numbers (a multiple of 3: vectors).

    The vectors of a node are positions (3), or a position and directors (6, 9, 12): linear momentum counts the first.
    """

    index_map: IndexMap
    size: int


@runtime_checkable
class Body(Protocol):
    """Something with coordinates."""

    name: str
    comm: MPI.Intracomm
    block: Block

    def initial_state(self) -> tuple[Array, Array]:
        """Owned coordinates [m] and velocities [m/s], flattened, node by node; not to be written to."""
        ...

    def terms(self) -> Iterable[Term]:
        """What it adds to the equations by itself."""
        ...

    def describe(self, node: int) -> str:
        """Where an owned node is, in words, for messages."""
        ...


@runtime_checkable
class MeshBody(Body, Protocol):
    """A body discretised on a mesh: its coordinates are functions of a Lagrange space."""

    space: fem.FunctionSpace

    def coordinates(self, alpha: float) -> Any:
        """How these functions follow from its unknowns, for a rule with the weight α: a `terms.coordinates`."""
        ...


def is_body(item: object) -> TypeGuard[Body]:
    """Whether a scene's item has coordinates."""
    return hasattr(item, "block")


def is_on_mesh(body: Body) -> TypeGuard[MeshBody]:
    """Whether a body is discretised on a mesh."""
    return hasattr(body, "space")


def has_nodal_unknowns(body: Body) -> TypeGuard[MeshBody]:
    """Whether a body's unknowns are the coordinates of the nodes of its mesh."""
    return (
        is_on_mesh(body)
        and body.block.index_map.size_global == body.space.dofmap.index_map.size_global
    )


@runtime_checkable
class Stateful(Protocol):
    """Something with a past that the coordinates do not tell; any field of a term may be."""

    def get_state(self) -> dict[str, Any]:
        """Numbers, words and lists of them, the same on every rank."""
        ...

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` returned; coordinates and velocities are those of then."""
        ...


@check_arguments
@dataclass(frozen=True, eq=False)
class Port:
    """A vector attached to a body: Σ_k weights[k] q[nodes[k], vectors[k]], a constant linear map of its coordinates.

    `nodes` are global nodes of the body's block; `vectors` says which of a node's vectors is meant: 0 the position
    (the default), 1, 2, ... the directors.  With weights of sum 1 on positions it is a point of the body.
    """

    body: Body
    nodes: tuple[int, ...]
    _: KW_ONLY
    weights: tuple[float, ...] = (1.0,)
    vectors: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        count = self.body.block.index_map.size_global
        check(
            all(0 <= node < count for node in self.nodes),
            f"A port of '{self.body.name}' has the nodes {self.nodes}; its nodes are 0 to {count - 1}.",
        )


@check_arguments
@dataclass(frozen=True)
class Ground:
    """A vector that stays what it is: a point [m] or a direction of inertial space."""

    vector: tuple[float, float, float]


Attached = Port | Ground


class Term(Protocol):
    """Something that adds to the equations; `compiler` compiles all terms of its kind in a scene at once."""

    compiler: ClassVar[type[CompiledTerms]]


@runtime_checkable
class Assembly(Protocol):
    """What compiled terms and borders see of the system: bodies, their numbering, and the coordinates of the step.

    A step goes from q0 at `time` to q1, `h` seconds later; forces act at q̄ = (1-α) q0 + α q1, α = `rule.alpha`.
    `fields[k]` are the coordinates of body k, which is on a mesh, as functions; `past` are those before the last step.
    Tangents have the share `geometric` of the stiffness that comes from present stresses and moments: 1, or 0 in a
    careful start of the iteration.
    """

    comm: MPI.Intracomm
    bodies: list[Body]
    terms: list[Any]
    numbering: Any
    fields: dict[int, Any]
    rule: Any
    past: PETSc.Vec
    q0: PETSc.Vec
    q1: PETSc.Vec
    v0: PETSc.Vec
    time: float
    h: float
    geometric: float


class CompiledTerms:
    """All terms of one kind, compiled: a kind overrides what it has a part in, the rest does nothing.

    All methods are called on all ranks together.  Forces [N] and matrices are in the numbering of the system.
    """

    supplies = False  # whether its forces are loads, whose work is `supplied`
    made_of_forms = (
        False  # whether all it adds comes from `tangent_forms`, `mass_forms` and forces alone
    )
    searches = (
        False  # whether its places change from step to step: then `search` and `widen` are called
    )
    losses: Sequence[str] = ()  # names of what dissipates, the same on every rank

    def __init__(self, terms: Sequence[Any], system: Assembly) -> None: ...

    # ---- before the first step ----------------------------------------------------------------------------------

    @classmethod
    def multipliers(cls, terms: Sequence[Any], comm: MPI.Intracomm) -> list[Block]:
        """Blocks of multipliers that stand behind the bodies' in the numbering."""
        return []

    def add_mass(self, M: PETSc.Mat) -> None:
        """Add a constant mass matrix."""

    def add_gyroscopic(self, G: PETSc.Mat, spin: tuple[float, float, float]) -> None:
        """Add the matrix of the Coriolis force 2 M (ω×v) in a frame that turns with ω = `spin` [rad/s]."""

    def add_stiffness(self, K: PETSc.Mat) -> None:
        """Add the constant matrix of a quadratic energy ½ q·Kq: its force is K q̄, its tangent costs nothing."""

    # ---- a step -------------------------------------------------------------------------------------------------

    def search(self) -> None:
        """Before a step: find the places anew.  Only if it `searches`."""

    def widen(self) -> bool:
        """After a step was solved: whether places were missed that its end needs.  They are found now, and it is
        solved again from there.  Only if it `searches`."""
        return False

    def limit(self, update: Array) -> None:
        """Shorten an update (n,) of this rank's coordinates in Newton's iteration where it is farther than the terms
        can follow.  Only if it `searches`."""

    def begin(self, t: float) -> None:
        """Start a step of length h; t is the time at which forces act."""

    def move(self, linearly: bool) -> None:
        """q1 was set; measures on meshes may follow linearly from the iterate before."""

    def add_forces(self, r: PETSc.Vec) -> None:
        """Add forces to the residual; those of loads with the opposite sign."""

    def mass_forms(self, k: int) -> list[fem.Form]:
        """Bilinear forms of the mass of body k."""
        return []

    def tangent_forms(self, k: int) -> list[fem.Form]:
        """Bilinear forms of the derivative of its forces on body k with respect to q1."""
        return []

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the rest of the derivative, to a matrix whose pattern is that of the first call."""

    def couplings(self, diagonal: PETSc.Vec | None) -> list[PETSc.Mat]:
        """New matrices of what else is in the derivative at the last `add_tangents`, zero at held coordinates: all of
        it, or what a preconditioner needs beside a matrix with this diagonal.  Only if it `searches`."""
        return []

    def inadmissible(self) -> str:
        """In words, what cannot be in the solution of a step; else nothing.  The same on every rank."""
        return ""

    def supplied(self) -> float:
        """Work of the step on this rank; before it is kept."""
        return 0.0

    def dissipated(self) -> Array:
        """Loss of the step on this rank, for each of the `losses`; before it is kept."""
        return np.zeros(0)

    def keep(self) -> None:
        """q0 is the start of the next step, whose end q1 it was."""

    def energies(self) -> dict[str, float]:
        """Stored energies [J] at q0 on this rank, by name."""
        return {}

    def in_cells(self, field: str, body: Body) -> tuple[Indices, Array] | None:
        """Local cells (n,) of a body and values (n,) there of an output field at q0, if it has such; a cell may come
        several times, and on any rank that knows it: the mean counts."""
        return None

    def at_nodes(self, field: str, body: Body) -> tuple[npt.NDArray[np.int64], Array] | None:
        """Global nodes (n,) of a body and values (n,) there of an output field at q0, if it has such; all ranks know
        all of them, and what several terms have adds up."""
        return None

    def solids(self) -> list[Solid]:
        """Solids for pictures, the same on every rank; after the initial state was taken."""
        return []

    def resultants(self) -> dict[str, Array]:
        """Force and torque about the origin (2, 3) of each load over the last step [N, N m] on this rank, by name."""
        return {}

    def momenta(self) -> Array:
        """What a moving frame adds to momentum and angular momentum at q0 (2, 3) [kg m/s, kg m²/s] on this rank."""
        return np.zeros((2, 3))


class CompiledConstraints(CompiledTerms):
    """Measures that stay zero, by multipliers that stand at the end of each rank's unknowns."""

    owned: slice  # the multipliers in this rank's part of a vector

    def places(self) -> list[list[tuple[Attached, ...]]]:
        """What each of this rank's multipliers ties, for each block of them."""
        raise NotImplementedError

    def violation(self, q: PETSc.Vec) -> float:
        """Largest violation in a state, in the constraint's own units; the same on every rank."""
        raise NotImplementedError

    def validate(self, q0: PETSc.Vec, v0: PETSc.Vec, free: PETSc.Vec) -> None:
        """See that the initial state keeps the constraints, and none follows from others; `free` is 0 where held."""
        raise NotImplementedError

    def idle(self, free: PETSc.Vec, q0: PETSc.Vec) -> npt.NDArray[np.int64]:
        """Positions in this rank's part of a vector of multipliers that touch held coordinates only."""
        raise NotImplementedError

    def add_curvature(self, v: PETSc.Vec, r: PETSc.Vec) -> None:
        """Add D²e[v, v] in the rows of the multipliers."""
        raise NotImplementedError
