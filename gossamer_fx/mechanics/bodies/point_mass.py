"""A mass without extension."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from dolfinx.common import IndexMap
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check, is_vector
from gossamer_fx.core.model.body import Array, Block, Port
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.terms.masses import NodeKineticEnergy


@check_arguments
class PointMass:
    """A point with mass.  It lives on rank 0.

    Args:
        mass: [kg], positive.
        position: [m] at the start.
        velocity: [m/s] at the start.
        comm: of the scene it is in.
        name: name in messages and output.

    Raises:
        InputError: a mass that is not positive.

    Example:
        >>> ball = gx.PointMass(1.0, (0.0, 0.0, 2.0), comm=comm)
        >>> run = gx.Simulation(gx.Scene(ball, gx.Gravity(ball)), gx.Midpoint(0.01))
        >>> run.run(until=0.1)
        >>> round(float(gx.probes.Position(ball.port(), "z")(run)), 4)
        1.951
    """

    def __init__(
        self,
        mass: float,
        position: tuple[float, float, float] = (0.0, 0.0, 0.0),
        *,
        velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
        comm: MPI.Intracomm = MPI.COMM_WORLD,
        name: str = "mass",
    ) -> None:
        """Check the arguments; the coordinates of the point are on rank 0.  Collective."""
        check(
            math.isfinite(mass) and mass > 0,
            f"PointMass '{name}': mass is {mass!r} kg; give a positive number.",
        )
        for what, value, unit in (("position", position, "m"), ("velocity", velocity, "m/s")):
            check(
                is_vector(value),
                f"PointMass '{name}': {what} is {value!r} {unit}; give three finite numbers.",
            )
        self.mass = mass
        self.name = name
        self.comm = comm
        self._position = np.asarray(position, dtype=float)
        self._velocity = np.asarray(velocity, dtype=float)
        self.block = Block(IndexMap(comm, 1 if comm.rank == 0 else 0), 3)

    def initial_state(self) -> tuple[Array, Array]:
        # All of it on rank 0, nothing elsewhere.
        here = 3 * self.block.index_map.size_local
        return self._position[:here].copy(), self._velocity[:here].copy()

    def terms(self, start: State) -> Iterable[Term]:
        yield NodeKineticEnergy(self, np.full((self.block.index_map.size_local, 1, 1), self.mass))

    def port(self) -> Port:
        """Where it is, for joints and springs."""
        return Port(self, (0,))

    def describe(self, node: int) -> str:
        return "the point mass"
