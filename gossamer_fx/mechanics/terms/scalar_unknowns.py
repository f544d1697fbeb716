"""Interfaces of a compiled scene for items that extend it: scalar unknowns and initial
conditions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from dolfinx import fem
from petsc4py import PETSc

from gossamer_fx.core.model.body import Array, Body
from gossamer_fx.core.model.state import InitialState
from gossamer_fx.mechanics.terms.assembly import Assembly


@dataclass(frozen=True)
class ScalarTotals:
    """Share of scalar unknowns in the ledger: energies [J], masses [kg]; supplied ones since the
    start."""

    stored: dict[str, float]
    supplied: float
    mass: float
    mass_supplied: float


@runtime_checkable
class InitialCondition(Protocol):
    """Something that changes the initial state of a whole scene, after that of its bodies was
    taken."""

    name: str

    def initialise(self, start: InitialState) -> None:
        """Change coordinates or velocities, by `start.place` and `start.set_in_motion`."""
        ...


class ScalarUnknowns(Protocol):
    """Scalar unknowns y coupled to whole fields, e.g. gas pressures: rows and columns outside the
    sparse matrix.

    They are the same on every rank.  With the coordinates z of the bodies, a Newton step reads

        [ A  G ] [δz]     [ r ]
        [ Hᵀ C ] [δy] = - [ s ]
    """

    size: int

    def start(self) -> None:
        """Take the initial state."""
        ...

    def begin_step(self, h: float, t: float) -> Array:
        """Start a step of length h whose rates are taken at time t; returns a first guess of y
        (size,)."""
        ...

    def residual(self, y: Array) -> Array:
        """s(y) (size,), each as a fraction of the quantity that it balances."""
        ...

    def add_force(self, values: Array) -> None:
        """Add the forces of these unknowns, at the y of the last `residual`, to the owned part of
        r."""
        ...

    def tangents(self, body: Body) -> Iterable[fem.Form]:
        """Their derivatives with respect to the coordinates of one body, as far as they are made of
        forms."""
        ...

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the rest of their derivatives to the matrix of all coordinates."""
        ...

    def coupling(self) -> tuple[list[Array | None], list[Array | None], Array]:
        """Owned parts of the columns of G and of H (None: zero), and C (size, size)."""
        ...

    def inadmissible(self) -> str:
        """In words, what cannot be in the solution of a step, e.g. a negative volume; else
        nothing."""
        ...

    def unsolved(self) -> str:
        """In words, of what the last residual is far from zero, e.g. the gas of a chamber; else
        nothing."""
        ...

    def commit(self) -> None:
        """End the step."""
        ...

    def totals(self) -> ScalarTotals:
        """Energies and masses now, and what was supplied since the start."""
        ...

    def states(self) -> Mapping[str, Any]:
        """What outputs and probes may read of it, by name: the gas of chambers."""
        ...

    def get_state(self) -> dict[str, Any]:
        """Its state and what was supplied: numbers, words and lists of them, the same on every
        rank."""
        ...

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` returned; coordinates and velocities are those of then."""
        ...


class ScalarsAdjoint(Protocol):
    """Derivatives of scalar unknowns, for gradients of runs; see `gas.adjoint` for the equations.

    Parameters are named by the item of the scene and by what the item calls them.

    Attributes:
        units: unit of each parameter, by (id of the item, name).
        sums: derivatives of the result by the parameters, so far.
    """

    units: dict[tuple[int, str], str]
    sums: dict[tuple[int, str], float]

    def start(self) -> None:
        """Begin new sums."""
        ...

    def value(self, item: Any, name: str) -> float:
        """The present value of a parameter."""
        ...

    def names_of(self, item: object) -> list[str]:
        """Names of the parameters of an item."""
        ...

    def linearise(self, h: float) -> None:
        """Take the derivatives of the residual at the solved step of length h [s]."""
        ...

    def take(self, ν: Array, μ: Array) -> Array:
        """Sum up parameters; the derivatives (size,) of the result by the scalars at the start of
        the step."""
        ...

    def carry(self, by_position: Array, by_velocity: Array) -> None:
        """Add what the geometry at the start of the step gives, in the reversed step."""
        ...

    def add_energy_derivative(self, share: float) -> None:
        """Add a share of the derivative of the stored energy by parameters, at given scalars."""
        ...

    def finish(self, by_start: Array, by_position: Array) -> None:
        """Add what the initial state of the run gives."""
        ...


@runtime_checkable
class DifferentiableScalars(Protocol):
    """Scalar unknowns of which gradients are known."""

    size: int

    def adjoint(self) -> ScalarsAdjoint:
        """Their derivatives."""
        ...


@runtime_checkable
class ChangesWithVolume(Protocol):
    """Scalar unknowns that are gas: at rest a process is chosen, and vibrations have its
    stiffness."""

    @property
    def is_closed(self) -> bool:
        """Whether nothing flows, so that at rest the gas is a function of its volumes."""
        ...

    def set_static_process(self, process: str) -> None:
        """Choose what stays constant while an equilibrium is looked for: "adiabatic", ..."""
        ...

    def vibration_stiffness(self) -> list[tuple[Array, float]]:
        """Pairs (g, κ) of the stiffness Σ κ g⊗g in a fast vibration; this rank's part of g."""
        ...

    def static_stiffness(self) -> list[tuple[Array, float]]:
        """The same for slow changes, by the process that was chosen."""
        ...


class ScalarUnknownsMaker(Protocol):
    """Compiles all items of one kind to one block of scalar unknowns."""

    def __call__(self, items: list[Any], system: Assembly) -> ScalarUnknowns: ...


@runtime_checkable
class BringsScalarUnknowns(Protocol):
    """An item of a scene that brings scalar unknowns.

    `scalar_unknowns` compiles all items of its kind; items that name the same maker share unknowns.
    """

    scalar_unknowns: ScalarUnknownsMaker
