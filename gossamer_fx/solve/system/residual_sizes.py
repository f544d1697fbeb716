"""How large a residual is, and how large its round-off."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.system.equations import Equations
from gossamer_fx.solve.system.unknowns import Unknowns


def out_of_balance(equations: Equations, r: PETSc.Vec) -> tuple[float, float]:
    """Norm of the forces in a residual [N], and the largest violation of a constraint, over its
    size in the scene, the same on every rank.  Collective."""
    constraints = equations.constraints
    if constraints is None:
        return float(r.norm()), 0.0
    values = r.array_r
    multipliers = constraints.owned
    forces = values[: multipliers.start]
    squares = float(forces @ forces)
    violations = np.abs(values[multipliers]) / constraints.sizes
    worst = float(violations.max(initial=0.0))
    comm = equations.unknowns.comm
    if comm.size > 1:
        squares = comm.allreduce(squares)
        worst = comm.allreduce(worst, op=MPI.MAX)
    return squares**0.5, worst


def body_imbalances(unknowns: Unknowns, r: PETSc.Vec) -> Array:
    """Norms (bodies,) of the forces of each body in a residual [N].  Collective."""
    return np.sqrt(unknowns.comm.allreduce(np.array(unknowns.body_sums(r.array_r**2))))


def force_scales(equations: Equations, diagonal: PETSc.Vec) -> tuple[float, Array]:
    """Norms [N] of the forces that cancel in the last residual, the scale of its round-off, from
    the diagonal of the tangent: of all of them, and of those of each body (bodies,), none in scenes
    of one body and in statics.  Collective."""
    unknowns = equations.unknowns
    squares = unknowns.increment.cancelling_squares(unknowns.M, diagonal, unknowns.q1)
    own = [squares.sum()]
    if len(unknowns.bodies) > 1 and not unknowns.rule.is_static:
        own += unknowns.body_sums(squares)
    # Forces of gas may act on any body.
    of_scalars = sum([scalars.force_square() for scalars in equations.scalar_unknowns])
    own_squares = np.array(own) + of_scalars
    # With contact this is asked in each iteration, and one rank has nothing to send.
    if unknowns.comm.size > 1:
        own_squares = unknowns.comm.allreduce(own_squares)
    norms = np.sqrt(own_squares)
    return float(norms[0]), norms[1:]
