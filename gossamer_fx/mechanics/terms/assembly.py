"""What compiled terms see of a system, and what the system asks of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Never, Protocol, Self, TypeVar, runtime_checkable

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.algebra.numbering import NumberedBlock, Numbering
from gossamer_fx.core.model.body import Attached, Body
from gossamer_fx.core.model.roles import Tangents
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.terms.coordinates import Coordinates
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule


@dataclass(frozen=True)
class Part:
    """An item of a scene with the terms that it brings."""

    item: object
    terms: Sequence[Term]


@runtime_checkable
class Assembly(Protocol):
    """What compiled terms and scalar unknowns see of the system.

    A step goes from q0 at `time` to q1, `h` seconds later; forces act at
    q_mid = (1-α) q0 + α q1, α = `rule.alpha`.

    Attributes:
        fields: coordinates of bodies on meshes, as functions for forms.
        state: the accepted state, at `time`.
        end: positions at the end of the step, as iterated.
        previous: coordinates at the start of the last accepted step.
        geometric: share of the geometric stiffness that tangents have: 1, or 0 in initial
            iterations without it.
    """

    comm: MPI.Intracomm
    bodies: list[Body]
    terms: list[Term]
    numbering: Numbering
    fields: dict[Body, Coordinates]
    rule: StressRule
    state: State
    end: State
    previous: PETSc.Vec
    q0: PETSc.Vec
    q1: PETSc.Vec
    v0: PETSc.Vec
    time: float
    h: float
    geometric: float

    @property
    def initial(self) -> State:
        """The state in which the scene starts."""
        ...

    def block(self, body: Body) -> NumberedBlock:
        """The unknowns of a body in the numbering of the system."""
        ...


# The kind of terms that a class compiles.  Contravariant: what compiles stored energies and
# dissipation can also compile stored energies alone.
KindOfTerm = TypeVar("KindOfTerm", contravariant=True)


# Type checkers infer no variance from a constructor, so that it is declared in the older way.
class CompiledTerms(ABC, Generic[KindOfTerm]):  # noqa: UP046
    """All terms of one kind, compiled; the roles that they play are its other bases
    (`model.roles`)."""

    @abstractmethod
    def __init__(self, terms: Sequence[KindOfTerm], system: Assembly) -> None: ...

    @classmethod
    def compile(cls, terms: Sequence[KindOfTerm], system: Assembly) -> list[Self]:
        """Return what all terms of the kind in a scene become: one object for all, or several."""
        return [cls(terms, system)]

    def has(self, term: object) -> bool:
        """Return whether it was compiled from a term of its kind."""
        return True


# What a kind of terms names as its compiler.  Nothing is a `Never`, so any class of compiled terms
# is one.
type Compiler = type[CompiledTerms[Never]]


class CompiledConstraints(Tangents, CompiledTerms[KindOfTerm]):
    """Measures that stay zero, by multipliers that stand at the end of each rank's unknowns."""

    owned: slice  # the multipliers in this rank's part of a vector

    @abstractmethod
    def tied_ports(self) -> list[list[tuple[Attached, ...]]]:
        """The ports that each of this rank's multipliers ties, for each block of them."""

    @abstractmethod
    def violation(self, q: PETSc.Vec) -> float:
        """Largest violation in a state, in the constraint's own units; the same on every rank."""

    @abstractmethod
    def validate(self, q0: PETSc.Vec, v0: PETSc.Vec, free: PETSc.Vec) -> None:
        """See that the initial state keeps the constraints, and none follows from others; `free` is
        0 where held."""

    @abstractmethod
    def idle(self, free: PETSc.Vec, q0: PETSc.Vec) -> npt.NDArray[np.int64]:
        """Positions in this rank's part of a vector of multipliers that touch held coordinates
        only."""

    @abstractmethod
    def add_curvature(self, v: PETSc.Vec, r: PETSc.Vec) -> None:
        """Add D²e[v, v] in the rows of the multipliers."""
