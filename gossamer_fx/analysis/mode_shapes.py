"""Shapes of a film in its modes of vibration, as a source of a basis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.equilibrium import Equilibrium
from gossamer_fx.analysis.natural_modes import Mode
from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import Array


@check_arguments
class ModeShapes:
    """Shapes x0 ± h φ of a film in modes φ about an equilibrium x0, for `reduce`; of complex modes both parts.

    Modes tell frequencies better than a recording does in which they are hardly excited.  They are motions without
    height: how a film gives way in its plane to a wave of some height is in recordings only, so give both.

    Args:
        body: in the scene of the equilibrium.
        equilibrium, modes: about which `modes` found them.
        height: h [m], the largest way of a node in any of the shapes.

    `positions` is a list of arrays (n, 3) [m] of this rank's own nodes.
    """

    def __init__(
        self, body: Membrane, equilibrium: Equilibrium, *, modes: Sequence[Mode], height: float
    ) -> None:
        system = equilibrium.system
        check(
            body in system.bodies,
            f"ModeShapes: '{body.name}' is not in the equilibrium's scene; give its film.",
        )
        check(height > 0, f"ModeShapes: height is {height!r} m; give a positive number.")
        owned = system.block(body).owned
        start = system.state[body].positions()
        self.positions: list[Array] = []
        for mode in modes:
            for part in (mode.shape.real, mode.shape.imag):
                φ = part[owned].reshape(-1, 3)
                largest = body.comm.allreduce(float(np.abs(φ).max(initial=0.0)), MPI.MAX)
                if largest > 1e-6 * body.comm.allreduce(
                    float(np.abs(mode.shape).max(initial=0.0)), MPI.MAX
                ):
                    self.positions += [start + sign * height / largest * φ for sign in (1.0, -1.0)]
