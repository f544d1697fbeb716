"""The state of a scene: where its bodies are and how they move, for everything that reads it.

Constraints, connectors and contact get the `InitialState` when a scene is compiled; outputs,
probes, gas and pictures get `system.state` in a run.  Both answer the same questions:

    state[body].positions()     positions (n, 3) [m] of this rank's nodes
    state[body].velocities()    velocities (n, 3) [m/s] of this rank's nodes
    state.vector(port)          the vector (3,) of a port, e.g. a point [m]; the same on every rank

Only steppers and initial conditions change a state.  Everyone else gets read-only arrays.

Numbering: the unknowns of a rank stand in one array, body after body in the order of the scene; a
body's unknowns stand node after node; a node's unknowns are its position and, for beams and rigid
bodies, its directors.  Lagrange multipliers follow behind all bodies, so that the same slices serve
vectors with and without them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.model.body import Array, Attached, Body, Ground, MeshBody, Port
from gossamer_fx.core.model.item import Item


class HasSystem:
    """Something with a compiled scene, `system`: a `Simulation` or an `Equilibrium`."""

    system: Any


class Sampled(Item, ABC):
    """An item that looks at the state of a run between steps, as a feedback does."""

    @abstractmethod
    def before_step(self, run: HasSystem, h: float) -> float:
        """Look at the state before a step of length h [s]; returns the length that it may have.
        Collective."""


class BodyState:
    """One body in a state; what it returns is of this rank and read-only, unless stated
    otherwise."""

    def __init__(self, body: Body, owned: slice, q: PETSc.Vec, v: PETSc.Vec) -> None:
        self.body = body
        # Its rows in vectors of this rank.
        self.owned = owned
        self._q = q
        self._v = v

    def coordinates(self) -> Array:
        """Coordinates (n, s, 3): position [m] and s - 1 directors of each owned node."""
        return self._vectors(self._q)

    def rates(self) -> Array:
        """Rates of the coordinates (n, s, 3): velocity [m/s] and rates of the directors [1/s]."""
        return self._vectors(self._v)

    def positions(self) -> Array:
        """Positions (n, 3) [m] of the owned nodes."""
        return self.coordinates()[:, 0]

    def velocities(self) -> Array:
        """Velocities (n, 3) [m/s] of the owned nodes."""
        return self.rates()[:, 0]

    def function(self) -> fem.Function:
        """The coordinates as a function on the mesh of a film, plate, cable or beam, with ghosts.

        Of a reduced film it is a function on the mesh of the film that was reduced.  Its values at
        a node are the position [m], and for beams the directors [-].  Collective.

        Raises:
            InputError: the body has no mesh, e.g. a rigid body.
        """
        body = self.body
        if not isinstance(body, MeshBody):
            raise InputError(
                f"'{body.name}' has no mesh; ask for its coordinates instead of a function."
            )
        coordinates = fem.Function(body.full.space)
        body.reconstruct(coordinates, self._q.array_r[self.owned])
        return coordinates

    def node_positions(self) -> Array:
        """Positions (n, 3) [m] of the owned nodes, of a reduced film those of the film that was
        reduced.  Collective."""
        body = self.body
        if not isinstance(body, MeshBody) or body.full is body:
            return self.positions()
        return self.local_positions()[: body.full.block.index_map.size_local]

    def local_positions(self) -> Array:
        """Positions (m, 3) [m] of owned and ghost nodes of a body on a mesh.  Collective."""
        function = self.function()
        size = function.function_space.dofmap.index_map_bs
        return function.x.array.reshape(-1, size)[:, :3]

    def gathered(self) -> Array:
        """Positions (N, 3) [m] of all nodes of the body, by global number, on every rank.

        Collective: all ranks call it.  It is meant for what every rank has to see whole, such as a
        line of a few points; a field on a mesh stays distributed.
        """
        positions = self.positions()
        if self.body.comm.size == 1:
            return positions
        # Owned nodes, rank after rank, are in the order of their global numbers.
        return np.concatenate(self.body.comm.allgather(positions.copy()))

    def _vectors(self, vector: PETSc.Vec) -> Array:
        """The body's part of a vector of all unknowns, (n, s, 3): s vectors of each owned node."""
        # `array_r` is a read-only view, so that readers cannot change the state.
        values: Array = vector.array_r[self.owned]
        return values.reshape(-1, self.body.block.size // 3, 3)


class State:
    """Coordinates and velocities of all bodies of a scene at one time.

    Args:
        bodies: in the order of their unknowns.
        comm: of the scene.
        q: coordinates; their local part begins with the unknowns of the bodies.
        v: their rates, in the same order.

    Raises:
        InputError: when asked for a body that is not in the scene.
    """

    def __init__(
        self, bodies: Sequence[Body], comm: MPI.Intracomm, q: PETSc.Vec, v: PETSc.Vec
    ) -> None:
        self.comm = comm
        self._q = q
        self._v = v
        ends = np.cumsum([0] + [_local_size(body) for body in bodies])
        # Keyed by identity: bodies are compared by what they are, not by their values.
        self._of = {
            id(body): BodyState(body, slice(int(start), int(end)), q, v)
            for body, (start, end) in zip(bodies, pairwise(ends), strict=True)
        }

    def __getitem__(self, body: Body) -> BodyState:
        """The state of one body; `InputError` if the body is not in the scene."""
        check(
            body in self,
            f"'{getattr(body, 'name', body)}' is not in the scene; its bodies are: "
            f"{', '.join(repr(one.body.name) for one in self) or 'none'}.",
        )
        return self._of[id(body)]

    def __contains__(self, body: object) -> bool:
        # By identity, as in `__init__`.
        return id(body) in self._of

    def __iter__(self) -> Iterator[BodyState]:
        return iter(self._of.values())

    def named(self, name: str) -> BodyState | None:
        """The state of the body with this name, if there is one."""
        return next((one for one in self if one.body.name == name), None)

    def extent(self) -> float:
        """The largest coordinate of a point of a body [m], 1 if all are zero: the round-off of
        positions is a fraction of it.  Collective."""
        largest = max((float(abs(one.positions()).max(initial=0.0)) for one in self), default=0.0)
        return float(self.comm.allreduce(largest, op=MPI.MAX)) or 1.0

    def vector(self, port: Attached) -> Array:
        """The vector (3,) of a port: a point [m] or a director.  Collective, the same on every
        rank."""
        # A point of the ground is not among the unknowns.
        if isinstance(port, Ground):
            return port.initial()
        return port.evaluate(self._q.array_r[self[port.body].owned])

    def vectors(self, ports: Sequence[Attached]) -> Array:
        """The vectors (k, 3) of several ports.  Collective, the same on every rank."""
        # Neighbouring bars of a tape share their ends, and each vector is a sum over all ranks.
        found: dict[object, Array] = {}
        keys = [vector_key(port) for port in ports]
        for key, port in zip(keys, ports, strict=True):
            if key not in found:
                found[key] = self.vector(port)
        return np.array([found[key] for key in keys]).reshape(-1, 3)

    def rate(self, port: Attached) -> Array:
        """The rate (3,) of the vector of a port, e.g. [m/s].  Collective, the same on every
        rank."""
        if isinstance(port, Ground):
            return port.initial_rate()
        return port.evaluate(self._v.array_r[self[port.body].owned])

    def rates(self, ports: Sequence[Attached]) -> Array:
        """The rates (k, 3) of several ports.  Collective, the same on every rank."""
        return np.array([self.rate(port) for port in ports]).reshape(-1, 3)


def vector_key(port: Attached) -> object:
    """What equal vectors of a body have in common; bodies may have no hash."""
    if isinstance(port, Port):
        return (id(port.body), port.nodes, port.weights, port.vectors)
    return id(port)


class InitialState(State):
    """The state in which a scene starts; initial conditions change it before the scene is compiled.

    It begins with what the bodies have by themselves (`Body.initial_state`).
    """

    def __init__(self, bodies: Sequence[Body], comm: MPI.Intracomm) -> None:
        """Make vectors with the state that the bodies have by themselves.  Collective."""
        # Without multipliers: constraints are compiled from this state, later.
        size = sum(map(_local_size, bodies))
        q = PETSc.Vec().createMPI((size, PETSc.DECIDE), comm=comm)
        v = q.duplicate()
        super().__init__(bodies, comm, q, v)
        # By the identity of the body: the shape that clamped edges refer to.
        self._made: dict[int, Array] = {}
        for one in self:
            coordinates, rates = one.body.initial_state()
            self.place(one.body, coordinates, as_made=True)
            self.set_in_motion(one.body, rates)

    def place(self, body: Body, coordinates: Array, *, as_made: bool = False) -> None:
        """Set the coordinates of a body's owned nodes, (n, s, 3) or flattened [m]; `as_made`: as if
        the body had been made there, e.g. folded."""
        self._q.array[self[body].owned] = np.ravel(coordinates)
        if as_made:
            self._made[id(body)] = np.ravel(coordinates)

    def made(self, body: Body) -> Array:
        """The coordinates (k,) of a body's owned nodes as it was made, which another state as start
        does not change."""
        return self._made[id(body)]

    def set_in_motion(self, body: Body, rates: Array) -> None:
        """Set the rates of the coordinates of a body's owned nodes, (n, s, 3) or flattened
        [m/s]."""
        self._v.array[self[body].owned] = np.ravel(rates)

    def copy_to(self, q: PETSc.Vec, v: PETSc.Vec) -> None:
        """Write the coordinates and rates of all bodies to vectors of the system, in which
        multipliers may follow behind the bodies; those are left as they are."""
        size = self._q.getLocalSize()
        q.array[:size] = self._q.array_r
        v.array[:size] = self._v.array_r


class InitialCondition(Item, ABC):
    """An item that changes the initial state of a whole scene, after that of its bodies was taken.

    Attributes:
        stage: when it acts.  Maps of folding act first (0), then constraints (1), whose pieces
            follow the folded films, then another scene as start (2), and rigid motions (3), whose
            velocities are those where the bodies are.
    """

    stage: ClassVar[int] = 0

    @abstractmethod
    def initialise(self, start: InitialState) -> None:
        """Change coordinates or velocities, by `start.place` and `start.set_in_motion`."""


def _local_size(body: Body) -> int:
    """Number of unknowns of a body that this rank owns."""
    return int(body.block.index_map.size_local) * body.block.size
