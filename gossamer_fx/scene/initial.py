"""Initial conditions of a whole scene: a rigid motion, or a state that was computed before."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.algebra.numbering import Numbering
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.model.scalar_unknowns import InitialCondition
from gossamer_fx.model.terms import Array, Assembly, Body, Vector


def start_coordinates(
    bodies: list[Body], conditions: Iterable[InitialCondition], comm: MPI.Intracomm
) -> list[Array]:
    """Owned coordinates of each body where initial conditions place it; nothing if none of them places bodies.

    Joints hold what they tie as it is at the start, so they have to know it before the scene is compiled.
    """
    placing = [condition for condition in conditions if not isinstance(condition, RigidMotion)]
    if not placing:
        return []
    numbering = Numbering(comm, [body.block for body in bodies])
    q, v = numbering.vector(), numbering.vector()
    for k, body in enumerate(bodies):
        q.array[numbering.owned(k)], v.array[numbering.owned(k)] = body.initial_state()
    bare: Any = SimpleNamespace(comm=comm, bodies=bodies, numbering=numbering, q0=q, q1=q, v0=v)
    for condition in placing:
        condition.initialise(bare, q, v)
    return [q.array_r[numbering.owned(k)].copy() for k in range(len(bodies))]


def vectors_of(system: Assembly, k: int, values: Array) -> Array:
    """View (n, s, 3) of the owned vectors of body k in the local part of a system's vector."""
    return values[system.numbering.owned(k)].reshape(-1, system.bodies[k].block.size // 3, 3)


@check_arguments
@dataclass(frozen=True, eq=False)
class RigidMotion:
    """Adds v + Ω × (x - c) to the initial velocities of all bodies, and Ω × d to those of their directors.

    Args:
        spin: Ω [rad/s].
        velocity: v [m/s].
        centre: c [m].
    """

    spin: Vector = (0.0, 0.0, 0.0)
    velocity: Vector = (0.0, 0.0, 0.0)
    _: KW_ONLY
    centre: Vector = (0.0, 0.0, 0.0)
    name: str = "rigid motion"

    def __post_init__(self) -> None:
        for what in ("spin", "velocity", "centre"):
            value = np.asarray(getattr(self, what), dtype=float)
            check(
                value.shape == (3,) and bool(np.isfinite(value).all()),
                f"RigidMotion '{self.name}': {what} is {value.tolist()!r}; give three finite numbers.",
            )

    def initialise(self, system: Assembly, q: PETSc.Vec, v: PETSc.Vec) -> None:
        positions = q.array_r.copy()
        with v as rates:
            for k in range(len(system.bodies)):
                x, moving = vectors_of(system, k, positions), vectors_of(system, k, rates)
                moving += np.cross(np.asarray(self.spin, dtype=float), x)
                moving[:, 0] += np.asarray(self.velocity, dtype=float) - np.cross(
                    self.spin, self.centre
                )


@check_arguments
@dataclass(frozen=True, eq=False)
class StartFrom:
    """Takes the initial positions and directors from another compiled scene of the same bodies, e.g. an equilibrium.

    A reduced film also starts from its full one: from the part of that shape which its modes hold.

    Args:
        system: the other scene's system; its `q0` is taken.
    """

    system: Assembly
    _: KW_ONLY
    name: str = "start"

    def initialise(self, system: Assembly, q: PETSc.Vec, v: PETSc.Vec) -> None:
        there = {body.name: k for k, body in enumerate(self.system.bodies)}
        source = self.system.q0.array_r
        with q as values:
            for k, body in enumerate(system.bodies):
                other = self.system.bodies[there[body.name]] if body.name in there else None
                full = other is not None and other is getattr(body, "full", None)
                same = other is not None and (full or other.block.size == body.block.size)
                check(
                    same,
                    f"'{self.name}' has no body '{body.name}' like this scene's; start from the same bodies.",
                )
                taken = source[self.system.numbering.owned(there[body.name])]
                if full:
                    taken = body.reduced(taken)  # type: ignore[attr-defined]
                here = values[system.numbering.owned(k)]
                check(
                    len(taken) == len(here),
                    f"'{body.name}' has other nodes in '{self.name}'; use the same mesh.",
                )
                here[:] = taken
