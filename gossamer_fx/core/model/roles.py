"""The roles that a compiled kind of terms may play in the equations.

All terms of one kind in a scene are compiled together, by the class that the term names as its
`compiler`.  That class plays the roles that it needs and names them as its bases:

    class PointEnergies(StepObserver, Forces, Tangents, StoredEnergies, Dissipation): ...

The system sorts compiled kinds by role once, when the scene is compiled; a kind is not asked for
what it has no part in.  All methods are collective: they are called on all ranks together.

Vectors and matrices are in the numbering of the system.  A step goes from coordinates q0 at time t0
to q1 at t1 = t0 + h; the forces of a step act on q_mid = (1 - α) q0 + α q1, α =
`system.rule.alpha`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.drawing import Solid
from gossamer_fx.core.model.body import Array, Block, Body, Indices, MeshBody

# ---- equations -----------------------------------------------------------------------------------


@runtime_checkable
class Mass(Protocol):
    """Has a constant mass matrix."""

    @abstractmethod
    def add_mass(self, M: PETSc.Mat) -> None:
        """Add the mass matrix [kg] to M."""
        ...

    @abstractmethod
    def add_gyroscopic(self, G: PETSc.Mat, spin: tuple[float, float, float]) -> None:
        """Add the matrix of the Coriolis force 2 M (ω×v) in a frame that turns with ω = `spin`
        [rad/s]."""
        ...


@runtime_checkable
class MassForms(Protocol):
    """Has a mass matrix that is assembled from forms on a mesh."""

    @abstractmethod
    def mass_forms(self, body: Body) -> list[fem.Form]:
        """Bilinear forms of the mass of a body; an empty list for bodies that it does not
        concern."""
        ...

    @abstractmethod
    def kinetic_forms(self, body: Body, v: Any, w: Any) -> list[Any]:
        """The same as UFL forms, of given velocities v and test functions w."""
        ...


@runtime_checkable
class ConstantStiffness(Protocol):
    """Has a quadratic energy ½ q·Kq: its force is K q_mid, and its tangent is assembled once."""

    @abstractmethod
    def add_stiffness(self, K: PETSc.Mat) -> None:
        """Add the constant stiffness [N/m] to K."""
        ...


@runtime_checkable
class Forces(Protocol):
    """Contributes to the residual."""

    @abstractmethod
    def add_forces(self, r: PETSc.Vec) -> None:
        """Add internal forces [N] to the residual r; loads with the opposite sign."""
        ...


@runtime_checkable
class Tangents(Protocol):
    """Contributes to the tangent, with a sparsity pattern that does not change."""

    @abstractmethod
    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the derivative of its forces with respect to q1; the first call sets the pattern."""
        ...


@runtime_checkable
class TangentForms(Protocol):
    """Contributes to the tangent by forms on a mesh."""

    @abstractmethod
    def tangent_forms(self, body: Body) -> list[fem.Form]:
        """Bilinear forms of the derivative of its forces on a body with respect to q1."""
        ...


# The marks have no method: a base class states a fact about the kind.
class OnMeshes:
    """Marks a kind of which everything comes from forms on meshes: nothing acts on or between
    points."""


class ExternalLoads:
    """Marks a kind whose forces are loads: reactions of supports balance them."""


# A class method: the numbering must know all blocks before any kind is compiled.
@runtime_checkable
class Multipliers(Protocol):
    """Needs Lagrange multipliers, numbered behind the bodies."""

    @classmethod
    @abstractmethod
    def multipliers(cls, terms: Sequence[Any], comm: MPI.Intracomm) -> list[Block]:
        """Blocks of multipliers for all terms of the kind."""
        ...


# ---- the course of a step ------------------------------------------------------------------------


@runtime_checkable
class StepObserver(Protocol):
    """Has to know when a step begins."""

    @abstractmethod
    def begin_step(self, t: float) -> None:
        """Start a step of length `system.h` [s] whose forces act at time t [s]."""
        ...


@runtime_checkable
class TimeDependence(Protocol):
    """Has quantities at the end of a step that depend on time, or on history variables, and not on
    q1."""

    @abstractmethod
    def take_time(self, t: float) -> None:
        """A state of time t [s] is about to be set, as the end of a step: take these quantities
        from it."""
        ...


@runtime_checkable
class IterateObserver(Protocol):
    """Has to know when the Newton iteration changes q1."""

    @abstractmethod
    def update(self, linearly: bool) -> None:
        """q1 was set; with `linearly`, strains on meshes may follow linearly from the last
        iterate."""
        ...


@runtime_checkable
class StateObserver(Protocol):
    """Has to know when a state is accepted."""

    @abstractmethod
    def commit(self) -> None:
        """The step was accepted: q0 is the start of the next step, whose end q1 it was."""
        ...


@runtime_checkable
class ActiveSet(Protocol):
    """Has a connectivity that changes from step to step, as contact has.

    Attributes:
        has_plateaus: whether a Newton iteration that converges may stay at one residual for many
            iterations, as where friction changes between sticking and sliding.
    """

    has_plateaus: bool = False

    @abstractmethod
    def update_active_set(self) -> None:
        """Rebuild the list of interacting pairs before a step."""
        ...

    @abstractmethod
    def extend_active_set(self) -> bool:
        """After a step was solved: add pairs that its end needs and that were missing.

        Returns True on a rank that added pairs; the step is then solved again from where it ended.
        """
        ...

    @abstractmethod
    def limit_update(self, update: Array) -> None:
        """Shorten a Newton update (n,) of this rank's coordinates, in place (step-length
        control)."""
        ...

    # Not abstract: dynamics has no such load.
    def set_static_load(self, force: float) -> None:
        """Take the norm [N] of all loads of an equilibrium, which pairs may have to carry."""

    @abstractmethod
    def coupling_matrices(self, diagonal: PETSc.Vec | None) -> list[PETSc.Mat]:
        """Its part of the tangent at the last residual, zero at fixed coordinates, as new matrices.

        With a diagonal: only the blocks that a preconditioner needs in addition to a matrix that
        has this diagonal.  The caller destroys them.
        """
        ...


@runtime_checkable
class StepCheck(Protocol):
    """May find the solution of a step inadmissible, e.g. because films have passed through each
    other."""

    @abstractmethod
    def inadmissible(self) -> str:
        """What is wrong with the solution, in words; empty if nothing is.  The same on every
        rank."""
        ...


@runtime_checkable
class HistoryVariables(Protocol):
    """Has history variables: they are not functions of the coordinates and have to be checkpointed.

    A field of a term may play this role too.
    """

    @abstractmethod
    def get_state(self) -> dict[str, Any]:
        """The history as numbers, strings and lists of them; the same on every rank."""
        ...

    @abstractmethod
    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` returned; coordinates and velocities have been restored."""
        ...


@runtime_checkable
class CellHistory(Protocol):
    """Has history variables in the cells of bodies, on which strains may depend."""

    @abstractmethod
    def cell_history(self) -> dict[str, tuple[MeshBody, Array]]:
        """By name: a body, and the values (n,) in the n cells that this rank owns.

        The arrays are those at work: they are written to when a state is restored, before strains
        follow.
        """
        ...


# ---- energy balance ------------------------------------------------------------------------------


@runtime_checkable
class StoredEnergies(Protocol):
    """Stores energy."""

    @abstractmethod
    def energies(self) -> dict[str, float]:
        """Stored energies [J] at q0 by name, this rank's share."""
        ...


@runtime_checkable
class Dissipation(Protocol):
    """Dissipates energy.

    `losses` are the names of what dissipates, the same on every rank.
    """

    # Names and values are separate, so that the ranks need to exchange numbers only.
    losses: Sequence[str]

    @abstractmethod
    def dissipated(self) -> Array:
        """Loss of the step [J] for each of the `losses`, this rank's share; asked before
        `commit`."""
        ...


@runtime_checkable
class Supply(Protocol):
    """Supplies energy: a load, a motor, a support that moves."""

    @abstractmethod
    def supplied(self) -> float:
        """Work of the step [J], this rank's share; asked before `commit`."""
        ...


@runtime_checkable
class Resultants(Protocol):
    """Can tell the resultants of its loads."""

    @abstractmethod
    def resultants(self) -> dict[str, Array]:
        """Force [N] and torque about the origin [N m], (2, 3), of each load over the last step.

        By name of the load; this rank's share.
        """
        ...


@runtime_checkable
class FrameMomenta(Protocol):
    """Describes the bodies in a moving frame, which has momentum itself."""

    @abstractmethod
    def momenta(self) -> Array:
        """What the frame adds to momentum [kg m/s] and angular momentum [kg m²/s], (2, 3), at q0.

        This rank's share.
        """
        ...


# ---- sensitivities -------------------------------------------------------------------------------


@runtime_checkable
class ResidualForms(Protocol):
    """Its forces are forms on meshes, which UFL can derive with respect to their coefficients.

    The forms must be complete: a kind with other forces, or with history variables, does not play
    this role.
    """

    @abstractmethod
    def residual_forms(self, body: Body, w: Any) -> list[Any]:
        """UFL forms of its part of the residual on a body, linear in the test function w.

        They are functions of the coordinates `fields[body]` at both ends of the step.
        """
        ...

    @abstractmethod
    def energy_forms(self, body: Body) -> list[Any]:
        """UFL forms of its stored energy at q1; an empty list for loads and dissipation."""
        ...

    # Most kinds assemble their forms in every residual and have nothing to forget.
    def parameters_changed(self) -> None:
        """Forget what was computed with coefficients that have other values now."""
        return


@runtime_checkable
class PointParameters(Protocol):
    """Its forces are arrays, and it knows their derivatives with respect to numbers of its terms.

    Keys are those of `Parameter.source`.  All methods are collective.
    """

    @abstractmethod
    def get_number(self, term: Any, key: str) -> Array:
        """The present value of a number or vector of a term, (k,)."""
        ...

    @abstractmethod
    def set_number(self, term: Any, key: str, value: Array) -> None:
        """Give a number of a term another value (k,)."""
        ...

    @abstractmethod
    def work_by_number(self, term: Any, key: str, w: PETSc.Vec) -> Array:
        """w·∂r/∂number (k,), r its residual in the present step; this rank's share."""
        ...

    @abstractmethod
    def energy_by_number(self, term: Any, key: str) -> Array:
        """∂ψ/∂number (k,) of its stored energy at q1; this rank's share."""
        ...


@runtime_checkable
class GradientLimits(Protocol):
    """Some of its terms may have no gradient, e.g. because their forces depend on the path of the
    state."""

    @abstractmethod
    def without_gradient(self) -> str:
        """In words, which term has no gradient, why, and what to do; empty if all have one."""
        ...


@runtime_checkable
class GradientNotes(Protocol):
    """Has forces of which a gradient has to be read with care, e.g. because they have kinks."""

    @abstractmethod
    def gradient_notes(self) -> list[str]:
        """One sentence for each such part of the scene, with its name."""
        ...


class Reversible:
    """Marks a kind whose forces of a step stay the same when its ends change places and h changes
    sign.

    The derivative of these forces with respect to the start of a step is then the tangent of the
    reversed step.
    """


@runtime_checkable
class ExchangesEnds(Protocol):
    """Has an active set that stays when the ends of a step change places; see `Reversible`.

    A tape records the active set of every step, so that the step is made again without a search.
    """

    # Not abstract: of creases, for example, all act in every step.
    def save_active_set(self) -> Any:
        """The active set of the last accepted step, as an object that does not change."""
        return None

    def load_active_set(self, saved: Any) -> None:
        """Start a step of length `h` of the system from its accepted state, with a saved active
        set."""
        return

    def activate_present(self) -> None:
        """Start a step of no length from the accepted state, with what has energy there."""
        return

    @abstractmethod
    def exchange_ends(self) -> None:
        """Take q0 and the time of the system as the start of the reversed step, with the same
        pairs."""
        ...


@runtime_checkable
class TabulatedCoefficients(Protocol):
    """Fills functions of forms with values at quadrature points."""

    @abstractmethod
    def expressions(self) -> dict[fem.Function, Any]:
        """UFL expressions of which the functions have the values, so that forms with them can be
        derived."""
        ...


@runtime_checkable
class StartDerivatives(Protocol):
    """Has forces that differ in the reversed step, and knows their derivatives by the start of a
    step.

    The reversed step leaves these forces out.
    """

    @abstractmethod
    def add_start_derivatives(
        self, μ: PETSc.Vec, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add (∂f/∂q0)ᵀ μ and (∂f/∂v0)ᵀ μ of these forces f in the solved step to two vectors.

        The system stands at the solution of the step, which has the adjoint vector μ.
        """
        ...


@runtime_checkable
class HistoryAdjoint(Protocol):
    """Has history variables s that are set in a step and act in later ones, and sums up Σ μ·∂f/∂s.

    The sums go from the last step to the first; `StartDerivatives` takes them to the start of the
    step in which s was set.
    """

    @abstractmethod
    def start_adjoint(self) -> None:
        """Forget all sums: a backward pass begins."""
        ...

    # Not abstract: loads store no energy.
    def add_energy_by_history(self, share: float) -> None:
        """Take a share of ∂ψ/∂s of the stored energy at q0 into the sums."""
        return

    # Most history variables follow from the start of a step only.
    def add_end_derivatives(self, by_position: PETSc.Vec) -> None:
        """Add what later steps give for the end of the solved step, of which s is a function."""
        return


@runtime_checkable
class MassDependence(Protocol):
    """Has forces that depend on the masses of bodies."""

    @abstractmethod
    def masses_changed(self) -> None:
        """Forget what was computed from the mass matrix, which has other values now."""
        ...

    @abstractmethod
    def derivatives_by_mass(self) -> dict[MeshBody, float]:
        """Derivative of the result by the mass [kg] of bodies, after a backward pass; the same on
        every rank."""
        ...


@runtime_checkable
class StepHistory(Protocol):
    """Has history variables that a tape of steps saves on each rank, without communication."""

    @abstractmethod
    def save_history(self) -> Any:
        """The history variables of the accepted state, as an object that does not change."""
        ...

    @abstractmethod
    def load_history(self, saved: Any) -> None:
        """Restore what `save_history` returned; coordinates and velocities have been restored."""
        ...


class IndependentOfShape:
    """Marks a kind of which nothing depends on the stress-free shape of a mesh."""


class WithoutParameters:
    """Marks a kind whose forces depend on coordinates, and on no parameter of any item."""


# ---- output --------------------------------------------------------------------------------------


@runtime_checkable
class CellFields(Protocol):
    """Has output fields with values in cells."""

    @abstractmethod
    def cell_values(self, field: str, body: Body) -> tuple[Indices, Array] | None:
        """Local cells (n,) of a body and values (n,) of a field there at q0; None if it has none.

        A cell may occur several times, and on any rank that knows it: the mean counts.
        """
        ...


@runtime_checkable
class NodeFields(Protocol):
    """Has output fields with values at nodes."""

    @abstractmethod
    def node_values(self, field: str, body: Body) -> tuple[npt.NDArray[np.int64], Array] | None:
        """Global nodes (n,) of a body and values (n,) of a field there at q0; None if it has none.

        Each value is returned by one rank; what several kinds have adds up.
        """
        ...


@runtime_checkable
class Drawable(Protocol):
    """Brings solids into pictures."""

    @abstractmethod
    def solids(self) -> list[Solid]:
        """Solids to draw, the same on every rank; asked once the initial state is set."""
        ...


def playing[R](role: type[R], compiled: Sequence[object]) -> list[R]:
    """Those of the compiled kinds that play a role.  Roles are looked up here and nowhere else."""
    return [kind for kind in compiled if isinstance(kind, role)]
