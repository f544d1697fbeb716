"""Shapes of a film in its modes of vibration, as a source of a basis for model reduction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.reduction.basis import Shapes
from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.analysis.vibration.natural_modes import Mode
from gossamer_fx.core.checks.arguments import check_arguments, positive
from gossamer_fx.core.checks.lookups import check_in_scene
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.membrane import Membrane

# The real or imaginary part of a mode is left out below this fraction of its largest component: the
# film does not move in it, or it is round-off.
NEGLIGIBLE_PART = 1e-6


@check_arguments
class ModeShapes(Shapes):
    """Shapes x0 ± h φ of a film in modes φ about an equilibrium x0, for `reduce`.

    A complex mode gives the shapes of its real and of its imaginary part.  Modes represent
    frequencies better than a recording in which they are hardly excited.  They are motions of
    infinitesimal height: the in-plane motion that belongs to a wave of finite height is only in
    recordings.  Therefore give both to `reduce`.

    Args:
        body: in the scene of the equilibrium.
        equilibrium: x0, found.
        modes: of this equilibrium, from `modes`.
        height: h [m], the largest coordinate of a displacement in each shape.

    Attributes:
        positions: the shapes, a list of arrays (n, 3) [m] of this rank's n nodes.

    Raises:
        InputError: the film is not in the scene, or the height is not positive.

    Example:
        >>> law = gx.analysis.Prestress(1e9, 0.3, density=1400.0, thickness=1e-4, tension=100.0)
        >>> drum = gx.Membrane(mesh, law, name="drum")
        >>> supports = [gx.Fixed(drum, edge) for edge in ("left", "right", "bottom", "top")]
        >>> equilibrium = gx.Equilibrium(gx.Scene(drum, *supports))
        >>> result = equilibrium.find()
        >>> modes = gx.analysis.modes(equilibrium, 1)
        >>> shapes = gx.analysis.ModeShapes(drum, equilibrium, modes=modes, height=0.01)
        >>> len(shapes.positions)
        2
    """

    def __init__(
        self,
        body: Membrane,
        equilibrium: Equilibrium,
        *,
        modes: Sequence[Mode],
        height: Annotated[float, positive("m")],
    ) -> None:
        system = equilibrium.system
        check_in_scene(f"ModeShapes: '{body.name}'", body in system.unknowns.bodies)
        owned = system.unknowns.block(body).owned
        x0 = system.unknowns.state[body].positions()
        self.positions: list[Array] = []
        for mode in modes:
            # Of all bodies, so that a mode of another body gives no shapes.
            largest_of_mode = self._largest(body, mode.shape)
            for part in (mode.shape.real, mode.shape.imag):
                φ = part[owned].reshape(-1, 3)
                largest = self._largest(body, φ)
                if largest > NEGLIGIBLE_PART * largest_of_mode:
                    # Both signs: the mean of the shapes stays the equilibrium.
                    for sign in (1.0, -1.0):
                        self.positions.append(x0 + sign * height / largest * φ)

    @staticmethod
    def _largest(body: Membrane, values: np.ndarray) -> float:
        """Largest magnitude of an entry of `values` on all ranks of the body.  Collective."""
        largest_here = float(np.abs(values).max(initial=0.0))
        return float(body.comm.allreduce(largest_here, MPI.MAX))
