"""What contact sees of the system."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.mechanics.terms.assembly import Assembly


class FixedDofs(Protocol):
    """Which unknowns are prescribed.

    Attributes:
        held: their positions (k,) in this rank's part of a vector.
    """

    held: npt.NDArray[np.integer]


class ContactAssembly(Assembly, Protocol):
    """The system with what contact needs in addition to other terms.

    Attributes:
        M: mass matrix [kg], once the scene is compiled.
        supports: prescribed unknowns, whose rows of the tangent stay zero.
    """

    M: PETSc.Mat
    supports: FixedDofs
