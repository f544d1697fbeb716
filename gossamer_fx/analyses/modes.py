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
from typing import Any

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.analyses.equilibrium import Equilibrium
from gossamer_fx.checks.errors import NoEquilibrium, check

AT_REST = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Mode:
    """A vibration: `shape` is this rank's part of φ, complex in a turning frame.

    frequency [Hz] ≥ 0; growth [1/s], positive for an equilibrium that is not stable.
    """

    frequency: float
    growth: float
    shape: npt.NDArray[np.complex128]


def modes(
    equilibrium: Equilibrium,
    count: int,
    spin: tuple[float, float, float] = AT_REST,
    above: float = 0.0,
) -> list[Mode]:
    """The `count` modes of lowest frequency, at rest those nearest to the frequency `above` [Hz], in order.

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
        not system.borders,
        "modes: the scene has gas chambers, whose stiffness is not known here; give their pressure as Pressure.",
    )
    equilibrium.need("modes")
    system.inertia(0.0)
    K = system.tangent()
    M = system.M.copy()
    system.supports.clear(M, 0.0)
    if spin == AT_REST:
        found = _at_rest(K, M, count, (2 * math.pi * above) ** 2)
    else:
        G = system.gyroscopic(spin)
        system.supports.clear(G, 0.0)
        found = _turning(K, G, M, count)
    if len(found) < count:
        raise NoEquilibrium(f"Only {len(found)} of {count} modes converged; ask for fewer, or check the equilibrium.")
    return sorted(found, key=lambda mode: (mode.frequency, -mode.growth))[:count]


def _at_rest(K: PETSc.Mat, M: PETSc.Mat, count: int, shift: float) -> list[Mode]:
    """K φ = ω² M φ, near ω² = shift."""
    from slepc4py import SLEPc

    solver = SLEPc.EPS().create(K.comm)
    solver.setOperators(K, M)
    solver.setProblemType(SLEPc.EPS.ProblemType.GNHEP)  # loads that follow may make K unsymmetric
    solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    solver.setTarget(shift)
    solver.setDimensions(count)
    roots = [(cmath.sqrt(-ω2), shape) for ω2, shape in _solutions(solver, K)]
    return [Mode(abs(λ.imag) / (2 * math.pi), abs(λ.real), shape) for λ, shape in roots]


def _turning(K: PETSc.Mat, G: PETSc.Mat, M: PETSc.Mat, count: int) -> list[Mode]:
    """The quadratic problem; of each conjugate pair the one with positive frequency."""
    from slepc4py import SLEPc

    solver = SLEPc.PEP().create(K.comm)
    solver.setOperators([K, G, M])
    solver.setWhichEigenpairs(SLEPc.PEP.Which.TARGET_MAGNITUDE)
    solver.setTarget(0.0)
    solver.setDimensions(2 * count + 2)
    solver.setScale(SLEPc.PEP.Scale.SCALAR)
    return [Mode(λ.imag / (2 * math.pi), λ.real, shape) for λ, shape in _solutions(solver, K) if λ.imag >= 0]


def _solutions(solver: Any, K: PETSc.Mat) -> Iterator[tuple[complex, npt.NDArray[np.complex128]]]:
    """Eigenvalues, and this rank's parts of the vectors, by shift and inversion with a factorisation."""
    solver.setOptionsPrefix("gx_modes_")
    solver.setTolerances(1e-9, 500)
    inversion = solver.getST()
    inversion.setType("sinvert")
    inversion.getKSP().setType("preonly")
    inversion.getKSP().getPC().setType("lu")
    inversion.getKSP().getPC().setFactorSolverType("mumps")
    solver.setFromOptions()
    solver.solve()
    for i in range(solver.getConverged()):
        re, im = K.createVecs()
        yield complex(solver.getEigenpair(i, re, im)), re.array_r + 1j * im.array_r
