"""Iterates that stay on their sides: layers that passed through each other in an iterate are parted again.

Problem.  An update of Newton's method, and the predicted end of a step, may carry layers through each other.
Contact pushes them back (`kernels/pass_through.h`), but a packed film of many layers then needs tens of
iterations, or the step is rejected.

Idea.  A pair that passes through on the straight way of the step is put back to its side before forces are
evaluated: along the normal where it met, by opposite impulses on its two sides in the metric of the masses.
The impulses of a pair sum up to zero, so that the momentum of the iterate stays.  Pairs follow each other in
sweeps (Gauss-Seidel), since one pair may push the next.

The solution of a step does not change: only the points do at which Newton's iteration evaluates it.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from gossamer_fx.contact.arrays import Array
from gossamer_fx.contact.geometry.contact_points import ContactPoints
from gossamer_fx.contact.kernels.library import library
from gossamer_fx.contact.kernels.structs import pair_list
from gossamer_fx.contact.pair_table import ActivePairs
from gossamer_fx.contact.system_view import ContactAssembly

# Gap at which a pair is put that passed through, over its activation distance: well inside, where the
# contact force leads it farther, and not so close that this force exceeds all others.
SEPARATED_GAP = 0.3

# Sweeps over all pairs.  What is left then is pushed back by contact.
MAX_SWEEPS = 60


class Separation:
    """Parts the pairs of one contact in the iterates of a step.

    Args:
        points: of the contact.
        system: whose masses resist.
    """

    def __init__(self, points: ContactPoints, system: ContactAssembly) -> None:
        """Take points and system; `begin_step` computes the mobilities."""
        self._points = points
        self._system = system
        self._mobility: Array = np.zeros(0)

    def begin_step(self) -> None:
        """Compute the inverse masses (m,) [1/kg] of all points; collective."""
        system = self._system
        inverse = system.M.getDiagonal()
        inverse.reciprocal()
        # What is fixed, and obstacles, do not give way.
        inverse.array[system.supports.held] = 0.0
        count = self._points.body_count
        mobility = np.zeros(self._points.count)
        mobility[:count] = self._points.of_block_rows(inverse)[:count].min(axis=1)
        self._mobility = mobility

    def of(self, pairs: ActivePairs, x0: Array, x1: Array, change: PETSc.Vec) -> bool:
        """Add to a vector the displacement [m] that parts the pairs of this rank.

        Args:
            pairs: the active pairs.
            x0: points (m, 3) [m] at the start of the step.
            x1: points (m, 3) [m] of the iterate.
            change: of the unknowns; displacements of all ranks are added.

        Returns:
            whether any rank has parted any pair.
        """
        c = library()
        count = len(pairs)
        points = len(x0)
        parted = x1.copy()
        # x = (s - offset)/width of the squared distance s is one at the activation distance.
        distance = np.sqrt(np.maximum(pairs.offset + SEPARATED_GAP**2 * pairs.width, 0.0))
        separation = c.struct(
            "pair_separation",
            {
                "x0": c.array("x0", x0, "float64", (points, 3)),
                "x1": c.array("x1", parted, "float64", (points, 3), writable=True),
                "mobility": c.array("mobility", self._mobility, "float64", (points,)),
                "distance": c.array("distance", distance, "float64", (count,)),
                "max_sweeps": MAX_SWEEPS,
            },
        )
        moved = c.lib.separate_pairs(pair_list(pairs).pointer, separation.pointer)
        if not self._system.comm.allreduce(int(moved)):
            return False
        displacement = parted - x1
        displacement[self._points.body_count :] = 0.0
        self._points.add(displacement, change)
        return True
