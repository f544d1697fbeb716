"""The contract of compiled terms: what they see of a system, and what the system asks of them.

All terms of one kind in a scene are compiled together, by the class that the term names as its
`compiler`.  That class is a `CompiledTerms`, and overrides the methods in which its kind takes
part; all others do nothing.  What only some kinds have is a facet, a further base class:

    `Multipliers`       Lagrange multipliers among the unknowns
    `ActiveSet`         interacting pairs that change from step to step, as in contact
    `HistoryVariables`  a state that does not follow from coordinates and velocities
    `Differentiable`    derivatives with respect to parameters, for gradients of results
    `Shown`             output fields, or solids in pictures

A spring between bodies, for example, is

    class Springs(Differentiable, CompiledTerms["Spring"]): ...

Nothing is asked of a class because of the names of its methods.

All methods are collective: they are called on all ranks together.  Vectors and matrices are in the
numbering of the system.  A step goes from coordinates q0 at time t0 to q1 at t1 = t0 + h; the
forces of a step act on q_mid = (1 - α) q0 + α q1, α = `system.rule.alpha`.
"""

# Most steps of the contract are no-ops by intent: a kind overrides those that it needs.
# ruff: noqa: B027

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Never, Self, TypeVar

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.algebra.numbering import NumberedBlock, Numbering
from gossamer_fx.core.drawing import Solid
from gossamer_fx.core.model.body import Array, Attached, Block, Body, Indices, MeshBody
from gossamer_fx.core.model.state import InitialState, State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.terms.coordinates import Coordinates
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule


@dataclass(frozen=True)
class ItemTerms:
    """An item of a scene with the terms that it brings."""

    item: object
    terms: Sequence[Term]


class Assembly(ABC):
    """What compiled terms and scalar unknowns see of the system.

    A step goes from q0 at `time` to q1, `h` seconds later; forces act at
    q_mid = (1-α) q0 + α q1, α = `rule.alpha`.

    Attributes:
        initial: the state in which the scene starts.
        coordinates: of bodies on meshes, as functions for forms.
        state: the accepted state, at `time`.
        end: positions at the end of the step, as iterated.
        v0: rates of the coordinates at the start of the step.
        previous, previous_time: coordinates and time at the start of the last accepted step.
        compiled: the compiled kinds of terms, once all are.
        M: mass matrix [kg], once the scene is compiled.
        geometric: share of the geometric stiffness that tangents have: 1, or 0 in initial
            iterations without it.
    """

    comm: MPI.Intracomm
    initial: InitialState
    bodies: list[Body]
    terms: list[Term]
    compiled: list[CompiledTerms[Never]]
    numbering: Numbering
    M: PETSc.Mat
    coordinates: dict[Body, Coordinates]
    rule: StressRule
    state: State
    end: State
    previous: PETSc.Vec
    q0: PETSc.Vec
    q1: PETSc.Vec
    v0: PETSc.Vec
    time: float
    previous_time: float
    h: float
    geometric: float

    @property
    @abstractmethod
    def items(self) -> list[object]:
        """The items of the scene."""

    @abstractmethod
    def block(self, body: Body) -> NumberedBlock:
        """The unknowns of a body in the numbering of the system."""

    @abstractmethod
    def free_marks(self) -> PETSc.Vec:
        """A new vector with 0 at coordinates that are held, else 1."""


# The kind of terms that a class compiles.  Contravariant: what compiles stored energies and
# dissipation can also compile stored energies alone.
KindOfTerm = TypeVar("KindOfTerm", contravariant=True)


# Type checkers infer no variance from a constructor, so that it is declared in the older way.
class CompiledTerms(ABC, Generic[KindOfTerm]):  # noqa: UP046
    """All terms of one kind, compiled: their part in each step.

    Attributes:
        is_external_load: whether all its forces are loads, which reactions of supports balance.
        has_constant_stiffness: whether it has a quadratic energy ½ q·Kq, whose force K q_mid the
            system adds: its tangent is assembled once, by `add_stiffness`.
        losses: names of what dissipates, the same on every rank.
    """

    is_external_load: ClassVar[bool] = False
    has_constant_stiffness: ClassVar[bool] = False
    # Names and values are separate, so that the ranks need to exchange numbers only.
    losses: Sequence[str] = ()

    @abstractmethod
    def __init__(self, terms: Sequence[KindOfTerm], system: Assembly) -> None: ...

    @classmethod
    def compile(cls, terms: Sequence[KindOfTerm], system: Assembly) -> list[Self]:
        """Return what all terms of the kind in a scene become: one object for all, or several."""
        return [cls(terms, system)]

    def has(self, term: object) -> bool:
        """Return whether it was compiled from this term of its kind: always, unless `compile` makes
        several objects."""
        return True

    # ---- equations -------------------------------------------------------------------------------

    def add_mass(self, M: PETSc.Mat) -> None:
        """Add the constant mass matrix [kg] to M."""

    def add_gyroscopic(self, G: PETSc.Mat, spin: tuple[float, float, float]) -> None:
        """Add the matrix of the Coriolis force 2 M (ω×v) in a frame that turns with ω = `spin`
        [rad/s]."""

    def add_stiffness(self, K: PETSc.Mat) -> None:
        """Add the constant stiffness [N/m] to K; see `has_constant_stiffness`."""

    def add_forces(self, r: PETSc.Vec) -> None:
        """Add internal forces [N] to the residual r; loads with the opposite sign."""

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the derivative of its forces with respect to q1.

        The first call sets the sparsity pattern, which does not change.
        """

    def tangent_forms(self, body: Body) -> list[fem.Form]:
        """Bilinear forms of the derivative of its forces on a body on a mesh with respect to q1."""
        return []

    # ---- the course of a step --------------------------------------------------------------------

    def begin_search(self) -> None:
        """A search for the next equilibrium starts from the accepted state.  Its pseudo-steps are
        no path: history variables change here, and not at their ends."""

    def begin_step(self, t: float) -> None:
        """Start a step of length `system.h` [s] whose forces act at time t [s]."""

    def take_time(self, t: float) -> None:
        """A state of time t [s] is about to be set, as the end of a step.

        Take what depends on time, or on history variables, and not on q1.
        """

    def update(self, linearly: bool) -> None:
        """q1 was set, e.g. by the Newton iteration; with `linearly`, strains on meshes may follow
        linearly from the last iterate."""

    def inadmissible(self) -> str:
        """What is wrong with the solution of the step, in words; empty if nothing is.

        The same on every rank.  An example are films that have passed through each other.
        """
        return ""

    def commit(self) -> None:
        """The step was accepted: q0 is the start of the next step, whose end q1 it was."""

    def exchange_ends(self) -> None:
        """Take q0 and the time of the system as the start of the reversed step, with the pairs and
        stiffnesses of the step."""
        self.commit()

    # ---- energy balance --------------------------------------------------------------------------

    def energies(self) -> dict[str, float]:
        """Stored energies [J] at q0 by name, this rank's share."""
        return {}

    def dissipated(self) -> Array:
        """Loss of the step [J] for each of the `losses`, this rank's share; asked before
        `commit`."""
        return np.zeros(0)

    def supplied(self) -> float:
        """Work of the step [J] of loads, motors, moving supports, this rank's share; asked before
        `commit`."""
        return 0.0

    def resultants(self) -> dict[str, Array]:
        """Force [N] and torque about the origin [N m], (2, 3), of each load over the last step.

        By name of the load; this rank's share.
        """
        return {}

    def momenta(self) -> Array:
        """What a moving frame adds to momentum [kg m/s] and angular momentum [kg m²/s], (2, 3), at
        q0.

        This rank's share; zero unless the kind describes the bodies in such a frame.
        """
        return np.zeros((2, 3))


# What a kind of terms names as its compiler.  Nothing is a `Never`, so any class of compiled terms
# is one.
type Compiler = type[CompiledTerms[Never]]


# ---- facets --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Frames:
    """Sets of k directors d that stay orthonormal by m multipliers.

    Attributes:
        directors: global indices (n, 3k).
        multipliers: global indices (n, m).
        products: matrices H (m, 3k, 3k) of the measures ½ d·H d + c that are kept at zero.
    """

    directors: Indices
    multipliers: Indices
    products: Array


class Multipliers(ABC):
    """Measures that stay zero, by multipliers that stand at the end of each rank's unknowns.

    Attributes:
        owned: the multipliers in this rank's part of a vector.
        sizes: of their measures in the scene, in the same order and the units of the measures:
            what is small against them is round-off.
        can_switch: whether some of them engage and release in a run.
    """

    owned: slice
    sizes: Array
    can_switch: bool = False

    # A class method: the numbering must know all blocks before any kind is compiled.
    @classmethod
    @abstractmethod
    def multipliers(cls, terms: Sequence[Any], comm: MPI.Intracomm) -> list[Block]:
        """Blocks of multipliers for all terms of the kind, numbered behind the bodies."""

    @abstractmethod
    def add_forces(self, r: PETSc.Vec) -> None:
        """Add the forces of the multipliers, and the violations in their rows."""

    @abstractmethod
    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the rows and columns of the multipliers, see `CompiledTerms.add_tangents`."""

    @abstractmethod
    def tied_ports(self) -> list[list[tuple[Attached, ...]]]:
        """The ports that each of this rank's multipliers ties, for each block of them."""

    @abstractmethod
    def violation(self, q: PETSc.Vec) -> float:
        """Largest violation in a state, in the constraint's own units; the same on every rank."""

    @abstractmethod
    def validate(self, q0: PETSc.Vec, v0: PETSc.Vec, free: PETSc.Vec) -> None:
        """Check that the initial state fulfils the constraints and that none follows from others;
        `free` is 0 at held coordinates, else 1."""

    @abstractmethod
    def idle(self, free: PETSc.Vec, q0: PETSc.Vec) -> npt.NDArray[np.int64]:
        """Positions in this rank's part of a vector of multipliers that touch held coordinates
        only."""

    def linear_equations(self) -> list[tuple[int, dict[int, float]]]:
        """This rank's equations that are linear in the coordinates and always hold: the global
        index of the multiplier, and the coefficients by global index of the coordinate."""
        return []

    def frames(self) -> list[Frames]:
        """This rank's constraints that do nothing but keep directors orthonormal."""
        return []

    def switch(self) -> Iterator[str]:
        """Engage and release, one after the other, the constraints of which that is wanted; yields
        the name of each that holds from now on.  Collective."""
        return iter(())

    @abstractmethod
    def add_curvature(self, v: PETSc.Vec, r: PETSc.Vec) -> None:
        """Add D²e[v, v] in the rows of the multipliers."""


@dataclass(frozen=True, eq=False)
class CouplingBlocks:
    """Blocks of 3 x 3 of a tangent on one rank, sorted by row, then by column.

    Attributes:
        rows, columns: block row and block column of each (k,), three unknowns each.
        values: its nine entries (k, 9) [N/m], row by row.
    """

    rows: npt.NDArray[np.int64]
    columns: npt.NDArray[np.int64]
    values: Array


class ActiveSet(ABC):
    """Interacting pairs that change from step to step, as those of contact.

    Attributes:
        has_plateaus: whether a Newton iteration that converges may stay at one residual for many
            iterations, as where friction changes between sticking and sliding.
    """

    has_plateaus: bool = False

    @abstractmethod
    def update_active_set(self) -> None:
        """Rebuild the list of interacting pairs before a step."""

    @abstractmethod
    def extend_active_set(self) -> bool:
        """After a step was solved: add pairs that its end needs and that were missing.

        Returns True on a rank that added pairs; the step is then solved again from where it ended.
        """

    @abstractmethod
    def coupling_matrices(self, diagonal: PETSc.Vec | None) -> list[PETSc.Mat]:
        """Its part of the tangent at the last residual, zero at fixed coordinates, as new matrices.

        With a diagonal: only the blocks that a preconditioner needs in addition to a matrix that
        has this diagonal.  The caller destroys them.
        """

    def coupling_blocks(self) -> CouplingBlocks | None:
        """The blocks of `coupling_matrices` without a diagonal, from which a matrix is made faster;
        None: on several ranks, or where matrices have no blocks of three."""
        return None

    def limit_update(self, update: Array) -> None:
        """Shorten a Newton update (n,) of this rank's coordinates, in place (step-length
        control)."""

    def set_static_load(self, force: float, tensions: Mapping[str, float]) -> None:
        """Take what pairs may have to carry in an equilibrium: the norm [N] of all loads, and by
        the names of bodies the tensions of films [N/m] and of cables and beams [N]."""

    def stiffen(self) -> bool:
        """Stiffen pairs of an equilibrium that are nearly closed; whether there were any."""
        return False

    # A run tape records their active sets, so that a step is made again without a search.

    def save_active_set(self) -> Any:
        """The active set of the last accepted step, as an object that does not change."""
        return None

    def load_active_set(self, saved: Any) -> None:
        """Start a step of length `h` of the system from its accepted state, with a saved active
        set."""

    def activate_present(self) -> None:
        """Start a step of no length from the accepted state, with the pairs that have energy
        there."""


class HistoryVariables(ABC):
    """History variables: they are not functions of the coordinates and have to be checkpointed.

    A field of a term, or the law of a point load, may have this facet too.
    """

    @abstractmethod
    def get_history(self) -> dict[str, Any]:
        """The history by name, as objects that do not change: numbers, words and lists of them,
        which are the same on every rank, and `NamedRows`, of which each rank has its own.

        It is asked for in many steps: rows are exchanged only where a checkpoint is written.
        """

    @abstractmethod
    def set_history(self, state: dict[str, Any]) -> None:
        """Restore what `get_history` returned; coordinates and velocities have been restored.

        `NamedRows` of a checkpoint are those of all ranks.
        """

    def shape_history(self) -> dict[str, Any] | None:
        """The history that belongs to the shape, which a scene that starts from it takes over
        (`StartFrom`); None: it takes none, e.g. of what depends on the time of a run.  Collective.
        """
        return None

    def cell_history(self) -> dict[str, tuple[MeshBody, Array]]:
        """History variables in the cells of bodies, on which strains may depend.

        By name: a body, and the values (n,) in the n cells that this rank owns.  The arrays are
        those at work: they are written to when a state is restored, before strains follow.
        """
        return {}


def history_parts(term: Term) -> dict[str, HistoryVariables]:
    """The fields of a term that have history variables, by name."""
    return {name: part for name, part in vars(term).items() if isinstance(part, HistoryVariables)}


class Differentiable:
    """Derivatives of its forces with respect to parameters, for gradients of results.

    All its forces have known derivatives: they are complete in `residual_forms`, which UFL can
    derive with respect to coefficients, or they are arrays with derivatives by numbers of its terms
    (`work_by_number`), or they have no parameter.  Exceptions are named by `without_gradient`.

    The derivative with respect to the start of a step is the tangent of the reversed step, which
    goes from q1 to q0 with the length -h: forces have to stay the same.  A kind of which this is
    not true leaves such forces out of the reversed step, and gives `add_start_derivatives`.

    Attributes:
        reversible: whether all its forces are those of the reversed step; if not,
            `add_start_derivatives` is asked.
        forces_are_forms: whether nothing acts on or between points: all forces, if there are any,
            are assembled from forms.  Frequencies have gradients in such scenes.
        has_shape_derivative: whether the derivative with respect to the stress-free shape of a mesh
            is known, from forms, or zero.  Not, if the shape is measured when the scene is made.
    """

    reversible: bool = True
    forces_are_forms: ClassVar[bool] = False
    has_shape_derivative: ClassVar[bool] = False

    def without_gradient(self) -> str:
        """In words, which term has no gradient, why, and what to do; empty if all have one."""
        return ""

    def gradient_notes(self) -> list[str]:
        """One sentence for each item of the scene whose gradient has to be read with care, with
        its name."""
        return []

    # ---- forms -----------------------------------------------------------------------------------

    def kinetic_forms(self, body: Body, v: Any, w: Any) -> list[Any]:
        """UFL forms of its mass on a body, of given velocities v and test functions w."""
        return []

    def residual_forms(self, body: Body, w: Any) -> list[Any]:
        """UFL forms of its part of the residual on a body, linear in the test function w.

        They are functions of the coordinates `coordinates[body]` at both ends of the step.
        """
        return []

    def energy_forms(self, body: Body) -> list[Any]:
        """UFL forms of its stored energy at q1."""
        return []

    def expressions(self) -> dict[fem.Function, Any]:
        """UFL expressions of functions that it fills with values at quadrature points, so that
        forms with them can be derived."""
        return {}

    def parameters_changed(self) -> None:
        """Forget what was computed with coefficients that have other values now."""

    # ---- numbers of terms; keys are those of `Parameter.source` ----------------------------------

    def get_number(self, term: Any, key: str) -> Array:
        """The present value of a number or vector of a term, (k,)."""
        raise KeyError(key)

    def set_number(self, term: Any, key: str, value: Array) -> None:
        """Give a number of a term another value (k,)."""
        raise KeyError(key)

    def work_by_number(self, term: Any, key: str, w: PETSc.Vec) -> Array:
        """w·∂r/∂number (k,), r its residual in the present step; this rank's share."""
        raise KeyError(key)

    def energy_by_number(self, term: Any, key: str) -> Array:
        """∂ψ/∂number (k,) of its stored energy at q1; this rank's share.  Zero for loads."""
        return np.zeros(len(self.get_number(term, key)))

    def inertia_by_number(self, term: Any, key: str, v: PETSc.Vec, w: PETSc.Vec) -> Array:
        """w·∂M/∂number v (k,) of its mass matrix M; this rank's share.  Zero of most kinds."""
        return np.zeros(len(self.get_number(term, key)))

    # ---- forces that depend on masses ------------------------------------------------------------

    def work_on_masses(self, masses: Any, w: PETSc.Vec) -> float:
        """w·r of its part of the residual that acts on the masses of a term and is proportional to
        them, as a weight; this rank's share.  Zero of most kinds.  Collective."""
        return 0.0

    def masses_changed(self) -> None:
        """Forget what was computed from the mass matrix, which has other values now."""

    def derivatives_by_mass(self) -> dict[MeshBody, float]:
        """Derivative of the result by the mass [kg] of bodies, after a backward pass; the same on
        every rank."""
        return {}

    # ---- a backward pass over the steps of a run -------------------------------------------------

    def add_start_derivatives(
        self, μ: PETSc.Vec, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add (∂f/∂q0)ᵀ μ and (∂f/∂v0)ᵀ μ of forces f that the reversed step leaves out.

        The system stands at the solution of the step, which has the adjoint vector μ.
        """

    # History variables s that are set in one step act in later ones: Σ μ·∂f/∂s is summed up from
    # the last step to the first, and `add_start_derivatives` takes it to the step that set s.

    def start_adjoint(self) -> None:
        """Forget all sums: a backward pass begins."""

    def add_energy_by_history(self, share: float) -> None:
        """Add `share` times ∂ψ/∂s of the stored energy at q0 to the sums."""

    def add_end_derivatives(self, by_position: PETSc.Vec) -> None:
        """Add (∂s/∂q1)ᵀ times the sums, of history variables s that the solved step has set as
        functions of its end q1."""

    def add_initial_derivatives(self, by_position: PETSc.Vec) -> None:
        """Add (∂s/∂q)ᵀ times the sums, of history variables s that the initial state q has set; the
        system stands at the start of the recorded steps, which may be later.  Collective."""


class Shown:
    """Values in output fields, or solids in pictures."""

    def cell_values(self, field: str, body: Body) -> tuple[Indices, Array] | None:
        """Local cells (n,) of a body and values (n,) of a field there at q0; None if it has none.

        A cell may occur several times, and on any rank that knows it: the mean counts.
        """
        return None

    def node_values(self, field: str, body: Body) -> tuple[npt.NDArray[np.int64], Array] | None:
        """Global nodes (n,) of a body and values (n,) of a field there at q0; None if it has none.

        Each value is returned by one rank; what several kinds have adds up.
        """
        return None

    def solids(self) -> list[Solid]:
        """Solids to draw, the same on every rank; asked once the initial state is set."""
        return []
