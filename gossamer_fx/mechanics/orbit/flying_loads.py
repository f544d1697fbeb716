"""Loads that depend on where a scene flies: compiled as other loads, after the origin has made its
step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
import ufl

from gossamer_fx.extend import (
    Array,
    Assembly,
    Attached,
    Compiler,
    Expr,
    Loads,
    MeshBody,
    PointForce,
    PointLoad,
    PointLoads,
    Port,
    at_rate,
)
from gossamer_fx.mechanics.orbit.flight import Flight
from gossamer_fx.mechanics.orbit.orbit import Orbit


class FlyingLoads(Loads):
    """All `FlyingLoad` terms of a scene."""

    def __init__(self, terms: Sequence[FlyingLoad], system: Assembly) -> None:
        """Compile the terms as loads that depend on the mean velocity of the step."""
        self._flying = terms
        loads = [
            at_rate(term.name, term.body, term.work, system.coordinates[term.body])
            for term in terms
        ]
        super().__init__(loads, system)

    def begin_step(self, t: float) -> None:
        system = self._system
        for term in self._flying:
            flight = term.orbit.flight(system)
            flight.prepare(system)
            # The forms take velocities as differences over the step.
            system.coordinates[term.body].h.value = system.h
            term.prepare(flight, system)
        super().begin_step(t)


@dataclass(frozen=True, eq=False)
class FlyingLoad:
    """A load on a body on a mesh: `work(q, rate, w)` is its virtual work with the mean velocity of
    the step.  `prepare` sets its constants from the flight, before each step."""

    name: str
    body: MeshBody
    orbit: Orbit
    work: Callable[[Expr, Expr, Expr], ufl.Form]
    prepare: Callable[[Flight, Assembly], None]
    compiler: ClassVar[Compiler] = FlyingLoads


class FlyingForce(Protocol):
    """Force on attached vectors in flight; an array X (..., k, 3) may be complex."""

    def prepare(self, flight: Flight) -> None:
        """Take light, air or magnetic field of the coming step from the flight."""

    def forces(self, X: Array, rate: Array) -> Array:
        """Forces (..., k, 3) on vectors X (..., k, 3) and their mean rates."""


class _ByComplexSteps(PointForce):
    """A `FlyingForce` as a law of point loads, its derivative taken by complex steps, to
    round-off."""

    def __init__(self, law: FlyingForce) -> None:
        self._law = law
        # Seconds from the start of the step; any positive number serves before the first step.
        self._lag = 1.0
        self._X0: Array = np.zeros(0)

    def begin(self, t: float, lag: float, X: Array, V: Array) -> None:
        """Start a step from the vectors X of the ports, stored as `_X0`; mean rates are (X -
        X0)/lag."""
        self._lag = lag
        self._X0 = X

    def _forces(self, X: Any) -> Any:
        """Forces (..., k, 3) on the stacked vectors X (..., 3k), real or complex."""
        shape = (*X.shape[:-1], -1, 3)
        return self._law.forces(X.reshape(shape), ((X - self._X0) / self._lag).reshape(shape))

    def force(self, X: Array) -> Array:
        return self._forces(X).ravel()

    def tangent(self, X: Array) -> Array:
        """Derivatives (3k, 3k) of the forces with respect to the vectors X (3k,) of k ports, [N/m]
        for points, [N] for directors, by 3k complex steps at once; zero before the first step."""
        if not self._X0.size:  # before the first step only the pattern of the matrix is asked for
            return np.zeros((X.size, X.size))
        # A complex step subtracts nothing, so that it can be this small; its error is of the
        # order of its square.
        tiny = 1e-30
        stepped = self._forces(X + 1j * tiny * np.eye(X.size))
        return stepped.reshape(X.size, X.size).imag.T / tiny


class FlyingPointLoads(PointLoads):
    """All `FlyingPointLoad` terms of a scene."""

    def __init__(self, terms: Sequence[FlyingPointLoad], system: Assembly) -> None:
        self._flying = terms
        super().__init__(
            [PointLoad(t.name, t.ports, _ByComplexSteps(t.law)) for t in terms], system
        )

    def begin_step(self, t: float) -> None:
        """Prepare all laws for the step that is evaluated at time t [s]."""
        for term in self._flying:
            flight = term.orbit.flight(self._system)
            flight.prepare(self._system)
            term.law.prepare(flight)
        super().begin_step(t)


@dataclass(frozen=True, eq=False)
class FlyingPointLoad:
    """A load on points and directors of bodies in flight."""

    name: str
    ports: tuple[Attached, ...]
    orbit: Orbit
    law: FlyingForce
    compiler: ClassVar[Compiler] = FlyingPointLoads


def axes_of(body: Any) -> tuple[Port, ...]:
    """Position and directors of a rigid body."""
    return tuple(Port(body, (0,), weights=(1.0,), vectors=(k,)) for k in range(4))


class FacesForce:
    """A force on flat faces of a rigid body at its position and directors (..., 4, 3); area vectors
    (n, 3) [m²] and centres (n, 3) [m] are in body axes."""

    def __init__(self, areas: Array, centres: Array) -> None:
        self._areas = areas
        # Weights of position and directors in a centre c, which is x + Σ c_k d_k.
        self._arms = np.column_stack([np.ones(len(centres)), centres])

    def forces(self, X: Array, rate: Array) -> Array:
        """Forces (..., 4, 3) on position and directors X (..., 4, 3) that move with the rates."""
        # Area vectors turn with the directors; the position does not move them.
        faces = self._areas @ X[..., 1:, :]
        f = self.on_faces(faces, self._arms @ rate)
        # armsᵀ f: forces on position and directors that do the same virtual work.
        return np.swapaxes(np.swapaxes(f, -1, -2) @ self._arms, -1, -2)

    def on_faces(self, areas: Array, rates: Array) -> Array:
        """Forces (..., n, 3) [N] on faces with area vectors [m²], which point away from their
        fronts, and velocities of their centres [m/s], all (..., n, 3)."""
        raise NotImplementedError
