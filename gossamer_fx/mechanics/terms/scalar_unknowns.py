"""Scalar unknowns of a scene, and the items that bring them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from petsc4py import PETSc

from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.item import Item
from gossamer_fx.mechanics.terms.assembly import Assembly, HistoryVariables


@dataclass(frozen=True)
class ScalarTotals:
    """Share of scalar unknowns in the ledger: stored energies [J] by name and mass [kg] now, and
    energy [J] and mass [kg] that were supplied since the start."""

    stored: dict[str, float]
    supplied: float
    mass: float
    mass_supplied: float


class ScalarUnknowns(HistoryVariables):
    """Scalar unknowns y coupled to whole fields, e.g. gas pressures: rows and columns outside the
    sparse matrix.

    They are the same on every rank.  With the coordinates z of the bodies, a Newton step reads

        [ A  G ] [δz]     [ r ]
        [ Hᵀ C ] [δy] = - [ s ]

    One class compiles all items of a scene that name it as their `scalar_unknowns`.  Their history
    variables include what was supplied.
    """

    size: int

    @abstractmethod
    def __init__(self, items: list[Any], system: Assembly) -> None: ...

    # ---- a step ----------------------------------------------------------------------------------

    @abstractmethod
    def start(self) -> None:
        """Take the initial state."""

    @abstractmethod
    def begin_step(self, h: float, t: float) -> Array:
        """Start a step of length h whose rates are taken at time t; returns a first guess of y
        (size,)."""

    @abstractmethod
    def residual(self, y: Array) -> Array:
        """s(y) (size,), each as a fraction of the quantity that it balances."""

    @abstractmethod
    def add_force(self, values: Array) -> None:
        """Add the forces [N] of these unknowns, at the y of the last `residual`, to `values` (n,),
        this rank's part of r."""

    @abstractmethod
    def coupling(self) -> tuple[list[Array | None], list[Array | None], Array]:
        """This rank's parts (n,) of the columns of G and of H (None: zero), and C (size, size)."""

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the derivative of their forces with respect to the coordinates to the matrix A of all
        coordinates."""
        return

    def force_square(self) -> float:
        """This rank's part of the square [N²] of the forces that cancel in those of
        `add_force`, the scale of their round-off."""
        return 0.0

    def inadmissible(self) -> str:
        """In words, what cannot be in the solution of a step, e.g. a negative volume; else
        nothing."""
        return ""

    def unsolved(self) -> str:
        """In words, of what the last residual is far from zero, e.g. the gas of a chamber; else
        nothing."""
        return ""

    @abstractmethod
    def commit(self) -> None:
        """End the step."""

    # ---- results ---------------------------------------------------------------------------------

    @abstractmethod
    def totals(self) -> ScalarTotals:
        """Energies and masses now, and what was supplied since the start."""

    def states(self) -> Mapping[str, Any]:
        """What outputs and probes may read of it, by name: the gas of chambers."""
        return {}

    def flows(self) -> Mapping[str, float]:
        """Mass flows [kg/s] of gas through openings by name, means of the last accepted step."""
        return {}

    # ---- equilibria and vibrations ---------------------------------------------------------------

    @property
    def is_closed(self) -> bool:
        """Whether nothing flows, so that at rest the gas is a function of its volumes, with the
        derivatives of `static_stiffness`."""
        return False

    def set_static_process(self, process: str) -> None:
        """Choose what stays constant while an equilibrium is looked for: "adiabatic", ..."""
        return

    def static_stiffness(self) -> list[tuple[Array, float]]:
        """Pairs (g, κ) of the stiffness Σ κ g⊗g for slow changes, by the process that was chosen,
        at the state of the last residual, which need not be accepted; this rank's part of g."""
        return []

    def vibration_stiffness(self) -> list[tuple[Array, float]] | None:
        """Pairs (g, κ) as of `static_stiffness` in a fast vibration; None: they are not known, and
        the scene has no modes."""
        return None

    # ---- gradients -------------------------------------------------------------------------------

    def adjoint(self) -> Any:
        """An object with the methods of `gas.adjoint.GasAdjoint`, which derives the equations of
        these unknowns; None: the scene has no gradient."""
        return None

    def repeats(self, history: dict[str, Any]) -> bool:
        """Whether what is open or closed in the present step is so in the step that ended with
        these history variables."""
        return True


class BringsScalarUnknowns(Item):
    """An item that brings scalar unknowns.

    Attributes:
        scalar_unknowns: compiles all items of its kind; items that name the same class share
            unknowns.
    """

    scalar_unknowns: ClassVar[type[ScalarUnknowns]]
