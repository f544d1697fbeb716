"""The function `reduce`: from recorded motions of a film to its reduced model.

Steps: 1. check that the film has strains and mass only; 2. compute the modes (`basis`); 3. choose
the cells over which strains are integrated (`sampling`); 4. make the body (`reduced_membrane`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from gossamer_fx.analysis.reduction.basis import make_basis
from gossamer_fx.analysis.reduction.reduced_membrane import ReducedMembrane, check_reducible
from gossamer_fx.analysis.reduction.sampling import every_cell, sample_cells
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.membrane import Membrane


@runtime_checkable
class Motion(Protocol):
    """Recorded shapes of a film, e.g. `Snapshots` or `RecordedShapes`: positions (n, 3) [m] of this
    rank's nodes, one array for each shape."""

    positions: Sequence[Array]


@check_arguments
def reduce(
    body: Membrane,
    motions: Sequence[Motion],
    *,
    modes: int,
    cells: int | None = None,
) -> ReducedMembrane:
    """A reduced model of a film: 3 · (modes + 3) unknowns that move as the film did in `motions`.

    A film that is not plane has 3 · (modes + 4) unknowns.  The modes are mass-weighted singular
    vectors of all shapes, scalar fields with vectors as unknowns, so that energy, momentum and
    angular momentum are conserved; see `reduction.basis`.  The reduced film has the initial state,
    law and name of the film, and replaces it in a new scene.  Collective.

    Args:
        body: the film; it may not have bending stiffness, creases or contact.
        motions: `Snapshots` of runs, `RecordedShapes` of their folders, or `ModeShapes`.
        modes: number of singular vectors, in addition to those of homogeneous motions; ≥ 1.
        cells: largest number of cells of each rank over which strains are integrated, see
            `reduction.sampling`; None for all cells.

    Raises:
        InputError: there are no shapes, they are of another mesh or hold fewer modes, or the film
            has more than strains and mass.

    Example:
        >>> shapes = gx.reduction.Snapshots(film)
        >>> scene = gx.Scene(film, gx.Fixed(film, "left"), gx.Gravity(film))
        >>> gx.Simulation(scene, gx.Midpoint(dt=1e-3), outputs=[shapes]).run(until=5e-3)
        >>> reduced = gx.reduction.reduce(film, [shapes], modes=2)
        >>> reduced.block.size
        15
    """
    check_reducible(body)
    check(
        isinstance(motions, Sequence) and all(isinstance(motion, Motion) for motion in motions),
        f"reduce: motions is {motions!r}; give a list of `Snapshots` or `RecordedShapes`.",
    )
    shapes = [shape for motion in motions for shape in motion.positions]
    basis = make_basis(body, shapes, modes)
    check(
        cells is None or cells >= 1,
        f"reduce: cells is {cells!r}; take one or more, or None for all.",
    )
    # Without sampling the strains are integrated over all cells, each with the weight one.
    sample = every_cell(body) if cells is None else sample_cells(basis, cells)
    return ReducedMembrane(basis, sample, body.name)
