"""Small vibrations about an equilibrium, at rest or in a frame that turns with it.

With the tangent K and the constant mass M, and in a frame that turns with ω the Coriolis matrix G = 2 M ω×,

    (λ² M + λ G + K) φ = 0,    λ = growth + 2πi frequency.

K has the geometric stiffness of stresses and of loads that follow; the centrifugal force is a load of the equilibrium.
Multipliers of joints, rigid bodies and beams stay unknowns: they have no mass, so their eigenvalues are infinite.
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

AT_REST = (0.0, 0.0, 0.0)
ASIDE = 1e-12  # of |K|/|M|, the square of the largest frequency or more


@check_arguments
@dataclass(frozen=True)
class Mode:
    """A vibration: `shape` is this rank's part of φ, complex in a turning frame.

    frequency [Hz] ≥ 0; growth [1/s], positive for an equilibrium that is not stable.
    """

    frequency: float
    growth: float
    shape: npt.NDArray[np.complex128]


@check_arguments
def modes(
    equilibrium: Equilibrium,
    count: int,
    *,
    spin: tuple[float, float, float] = AT_REST,
    above: float = 0.0,
) -> list[Mode]:
    """The `count` modes whose frequency is nearest to `above` [Hz], in order; by default the lowest.

    Args:
        equilibrium: found; its state is the one about which the scene vibrates.
        spin: ω [rad/s] of the frame; the scene then contains `Centrifugal` forces of the same spin.

    Raises:
        InputError: no mode is asked for, or the scene has gas chambers.
        NoEquilibrium: the eigenvalue solver found fewer modes.
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
    system.supports.clear(M, 0.0)
    result, ω = equilibrium.result, 2 * math.pi * above
    # rigid motions make K singular: the place of the inversion is moved a little, to where nothing vibrates
    aside = 0.0 if result is None or result.regular else ASIDE * K.norm() / M.norm()
    if spin == AT_REST:
        found = _at_rest(K, M, count, ω**2 or -aside)
    else:
        G = system.gyroscopic(spin)
        system.supports.clear(G, 0.0)
        found = _turning(K, G, M, count, {"imaginary": ω} if ω else {"real": math.sqrt(aside)})
    if len(found) < count:
        raise NoEquilibrium(
            f"Only {len(found)} of {count} modes converged; ask for fewer, or check the equilibrium."
        )
    nearest = sorted(
        found, key=lambda mode: math.hypot(mode.growth, 2 * math.pi * (mode.frequency - above))
    )[:count]
    return sorted(nearest, key=lambda mode: (mode.frequency, -mode.growth))


class _Inverse:
    """(K - σ M)⁻¹ M, whose largest eigenvalues 1/(ω² - σ) are of the modes near σ."""

    def __init__(self, K: PETSc.Mat, M: PETSc.Mat, σ: float) -> None:
        A = K.copy()
        A.axpy(-σ, M, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self._M, self._Mx, self._pc = M, M.createVecLeft(), PETSc.PC().create(K.comm)
        self._pc.setOperators(A)
        factorisation.choose(self._pc, A)
        _check_inverted(factorisation.set_up(self._pc))

    def mult(self, A: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._M.mult(x, self._Mx)
        self._pc.apply(self._Mx, y)


def _check_inverted(problem: str) -> None:
    if problem:
        raise NoEquilibrium(
            f"modes: the stiffness is singular at the frequency asked for, {problem}; choose another."
        )


def _at_rest(K: PETSc.Mat, M: PETSc.Mat, count: int, shift: float) -> list[Mode]:
    """K φ = ω² M φ, near ω² = shift; loads that follow may make K unsymmetric."""
    operator = PETSc.Mat().createPython((K.getSizes()), _Inverse(K, M, shift), K.comm)
    operator.setUp()
    found = [(cmath.sqrt(-shift - 1 / θ), shape) for θ, shape in _largest(operator, count) if θ]
    return [Mode(abs(λ.imag) / (2 * math.pi), abs(λ.real), shape=shape) for λ, shape in found]


def _largest(
    operator: PETSc.Mat, count: int
) -> Iterator[tuple[complex, npt.NDArray[np.complex128]]]:
    """Eigenvalues of largest magnitude, and this rank's parts of the vectors."""
    from slepc4py import SLEPc

    solver = SLEPc.EPS().create(operator.comm)
    solver.setOperators(operator)
    solver.setProblemType(SLEPc.EPS.ProblemType.NHEP)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_MAGNITUDE)
    solver.setDimensions(count)
    solver.setOptionsPrefix("gx_modes_")
    solver.setTolerances(1e-9, 500)
    solver.setFromOptions()
    solver.solve()
    for i in range(solver.getConverged()):
        re, im = operator.createVecs()
        yield complex(solver.getEigenpair(i, re, im)), re.array_r + 1j * im.array_r


def _turning(
    K: PETSc.Mat, G: PETSc.Mat, M: PETSc.Mat, count: int, place: dict[str, float]
) -> list[Mode]:
    """The quadratic problem near a place of λ; of each conjugate pair the one with positive frequency."""
    from gossamer_fx.analysis.turning_modes import Inverse

    near = Inverse(K, G, M, **place)
    _check_inverted(near.problem)
    pairs = [near.pair(z) for _, z in _largest(near.operator(), 2 * count + 2)]
    return [Mode(λ.imag / (2 * math.pi), λ.real, shape=shape) for λ, shape in pairs if λ.imag >= 0]
