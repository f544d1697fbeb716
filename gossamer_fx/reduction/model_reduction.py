"""From the motions of a film to its reduced model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import Array
from gossamer_fx.reduction.basis import make_basis
from gossamer_fx.reduction.reduced_membrane import ReducedMembrane, check_reducible
from gossamer_fx.reduction.sampling import every_cell, sample_cells


@runtime_checkable
class Motion(Protocol):
    """Shapes of a film, e.g. `Snapshots`: owned positions (n, 3) each."""

    positions: Sequence[Array]


@check_arguments
def reduce(
    body: Membrane, motions: Sequence[Motion], *, modes: int, cells: int | None = None
) -> ReducedMembrane:
    """A film with 3·(modes + 3) unknowns (12 instead of 9 if it is not plane) that moves as it did in `motions`.

    Mass-weighted singular vectors of all shapes, scalar modes times vectors, so that every conservation law is kept;
    see `reduction.basis`.  It has the film's initial state, law and name, and takes its place in a new scene.

    Args:
        body: what is reduced; its `bending`, creases and contact cannot be.
        motions: `Snapshots` of runs in which it took part, `RecordedShapes` of their folders, or `ModeShapes`.
        modes: how many singular vectors are taken, beside those that make all homogeneous motions exact.
        cells: most cells of each rank over which strains are integrated, see `reduction.sampling`; None: all.

    Raises:
        InputError: no shapes, of another mesh, fewer modes in them than asked for, or a film with more than strains.
    """
    check_reducible(body)
    check(
        isinstance(motions, Sequence) and all(isinstance(motion, Motion) for motion in motions),
        f"reduce: motions is {motions!r}; give a list of `Snapshots` or `RecordedShapes`.",
    )
    shapes = [x for motion in motions for x in motion.positions]
    basis = make_basis(body, shapes, modes)
    check(
        cells is None or cells >= 1,
        f"reduce: cells is {cells!r}; take one or more, or None for all.",
    )
    sample = every_cell(body) if cells is None else sample_cells(basis, cells)
    return ReducedMembrane(basis, sample, body.name)
