"""Small vibrations about an equilibrium, at rest or in a frame that turns with it.

With the tangent K, the constant mass M and, in a frame that turns with ω, the Coriolis matrix G = 2 M ω×,

    (λ² M + λ G + K) φ = 0,    λ = growth + 2πi frequency                                     (1)

K contains the geometric stiffness of stresses and the stiffness of loads that follow the body; the
centrifugal force is a load of the equilibrium.  Lagrange multipliers of joints, rigid bodies and beams
remain unknowns: they have no mass, so that their eigenvalues are infinite.

Modes near a frequency are found by inversion there (shift and invert) with SLEPc's Krylov-Schur method:

    G = 0:   K φ = ω² M φ,   the largest eigenvalues θ = 1/(ω² - σ) of (K - σ M)⁻¹ M          (2)
    G ≠ 0:   see `analysis.turning_modes`

Cost.  One factorisation, of twice the size for a frequency other than zero in a turning frame, and one
solution with it for each Krylov vector.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.analysis.equilibrium import Equilibrium
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import NoEquilibrium, check
from gossamer_fx.solvers import factorisation

Shape = npt.NDArray[np.complex128]

AT_REST = (0.0, 0.0, 0.0)

# Rigid motions make K singular.  The shift is then moved from zero by this fraction of |K|/|M|, which is
# at most the square of the largest frequency, to where no mode is.
SHIFT_RATIO = 1e-12

# Tolerance of the eigenvalue solver, relative to the eigenvalue, and its largest number of restarts.
EIGENVALUE_TOLERANCE = 1e-9
MAX_RESTARTS = 500

DIFFERENT_PATTERN = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN


@check_arguments
@dataclass(frozen=True)
class Mode:
    """A vibration.

    Attributes:
        frequency: [Hz], zero or positive.
        growth: [1/s]; positive for an equilibrium that is not stable.
        shape: this rank's part of φ, (unknowns of this rank,); complex in a turning frame.

    Example:
        >>> mode = gx.analysis.Mode(frequency=2.0, growth=0.0, shape=np.ones(3, dtype=complex))
        >>> mode.frequency
        2.0
    """

    frequency: float
    growth: float
    shape: Shape


@check_arguments
def modes(
    equilibrium: Equilibrium,
    count: int,
    *,
    spin: tuple[float, float, float] = AT_REST,
    above: float = 0.0,
) -> list[Mode]:
    """The `count` modes whose frequencies are nearest to `above`, in ascending order.

    Args:
        equilibrium: the state about which the scene vibrates; `find` was called.
        count: number of modes.
        spin: ω of the frame [rad/s].  The scene then contains `Centrifugal` forces of the same spin.
        above: frequency [Hz]; the default finds the lowest modes.

    Raises:
        InputError: a value is out of its range, the scene has gas chambers, or no equilibrium was found.
        NoEquilibrium: the stiffness is singular, or the eigenvalue solver found fewer modes.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> equilibrium = gx.Equilibrium(gx.Scene(weight, spring))
        >>> result = equilibrium.find()
        >>> [round(mode.frequency, 2) for mode in gx.analysis.modes(equilibrium, 3)]
        [0.48, 0.48, 1.59]
    """
    system = equilibrium.system
    check(above >= 0, f"modes: above is {above!r} Hz; give zero or a positive frequency.")
    check(count > 0, f"modes: count is {count!r}; ask for one or more.")
    check(
        not system.scalar_unknowns,
        "modes: the scene has gas chambers, whose stiffness is not known here; give their pressure as Pressure.",
    )
    equilibrium.need("modes")
    system.set_inertia(0.0)
    K = system.tangent()
    M = system.M.copy()
    # Rows of fixed coordinates: 1 in K and 0 in M, so that their eigenvalues are infinite.
    system.supports.clear(M, 0.0)
    away_from_zero = 0.0
    if equilibrium.result is not None and not equilibrium.result.regular:
        away_from_zero = SHIFT_RATIO * K.norm() / M.norm()
    ω = 2 * math.pi * above
    if not any(spin):
        found = _modes_at_rest(K, M, count, ω**2 or -away_from_zero)
    else:
        G = system.gyroscopic(spin)
        system.supports.clear(G, 0.0)
        shift = {"real": math.sqrt(away_from_zero)}
        if ω:
            shift = {"imaginary": ω}
        found = _modes_in_turning_frame(K, G, M, count, shift)
    if len(found) < count:
        raise NoEquilibrium(
            f"Only {len(found)} of {count} modes converged; ask for fewer, or check the equilibrium."
        )

    def distance(mode: Mode) -> float:
        """Of λ from the wanted one [1/s]."""
        return math.hypot(mode.growth, 2 * math.pi * (mode.frequency - above))

    nearest = sorted(found, key=distance)[:count]
    return sorted(nearest, key=lambda mode: (mode.frequency, -mode.growth))


class _ShiftedInverse:
    """The operator (K - σ M)⁻¹ M of (2), as PETSc's Python matrix."""

    def __init__(self, K: PETSc.Mat, M: PETSc.Mat, σ: float) -> None:
        shifted = K.copy()
        shifted.axpy(-σ, M, DIFFERENT_PATTERN)
        self._M = M
        self._Mx = M.createVecLeft()
        self._pc = PETSc.PC().create(K.comm)
        self._pc.setOperators(shifted)
        factorisation.choose(self._pc, shifted)
        _check_inverse(factorisation.set_up(self._pc))

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set y = (K - σ M)⁻¹ M x; called by SLEPc."""
        self._M.mult(x, self._Mx)
        self._pc.apply(self._Mx, y)


def _check_inverse(problem: str) -> None:
    """Raise `NoEquilibrium` if a factorisation has failed."""
    if problem:
        raise NoEquilibrium(
            f"modes: the stiffness is singular at the frequency asked for, {problem}; choose another."
        )


def _modes_at_rest(K: PETSc.Mat, M: PETSc.Mat, count: int, shift: float) -> list[Mode]:
    """Modes of (2) near ω² = shift [1/s²]; loads that follow the body may make K unsymmetric."""
    inverse = _ShiftedInverse(K, M, shift)
    operator = PETSc.Mat().createPython((K.getSizes()), inverse, K.comm)
    operator.setUp()
    found = []
    for θ, shape in _largest_eigenpairs(operator, count):
        # θ = 0 is that of an infinite frequency.
        if θ:
            λ = cmath.sqrt(-shift - 1 / θ)
            frequency = abs(λ.imag) / (2 * math.pi)
            found.append(Mode(frequency, growth=abs(λ.real), shape=shape))
    return found


def _largest_eigenpairs(operator: PETSc.Mat, count: int) -> Iterator[tuple[complex, Shape]]:
    """Eigenvalues of largest magnitude, and this rank's parts of their vectors."""
    # Imported here, as only modes need it.
    from slepc4py import SLEPc

    solver = SLEPc.EPS().create(operator.comm)
    solver.setOperators(operator)
    solver.setProblemType(SLEPc.EPS.ProblemType.NHEP)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_MAGNITUDE)
    solver.setDimensions(count)
    solver.setOptionsPrefix("gx_modes_")
    solver.setTolerances(EIGENVALUE_TOLERANCE, MAX_RESTARTS)
    solver.setFromOptions()
    solver.solve()
    for i in range(solver.getConverged()):
        real, imaginary = operator.createVecs()
        eigenvalue = complex(solver.getEigenpair(i, real, imaginary))
        yield eigenvalue, real.array_r + 1j * imaginary.array_r


def _modes_in_turning_frame(
    K: PETSc.Mat, G: PETSc.Mat, M: PETSc.Mat, count: int, shift: dict[str, float]
) -> list[Mode]:
    """Modes of (1) near λ = shift; of each conjugate pair the one with positive frequency."""
    # Imported here, as scenes at rest must not pay for it.
    from gossamer_fx.analysis.turning_modes import Inverse

    inverse = Inverse(K, G, M, **shift)
    _check_inverse(inverse.problem)
    found = []
    # Both of each conjugate pair are found, and one more in case that a pair is divided.
    for _, z in _largest_eigenpairs(inverse.operator(), 2 * count + 2):
        λ, shape = inverse.pair(z)
        if λ.imag >= 0:
            found.append(Mode(λ.imag / (2 * math.pi), growth=λ.real, shape=shape))
    return found
