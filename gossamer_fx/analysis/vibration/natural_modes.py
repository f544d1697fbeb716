"""Small vibrations about an equilibrium, at rest or in a frame that turns with it, and the number
of modes between two frequencies.

With the tangent K, the constant mass M and, in a frame that turns with ω, the Coriolis matrix G = 2
M ω×,

    (λ² M + λ G + K) φ = 0,    λ = growth + 2πi frequency                                     (1)

K contains the geometric stiffness of stresses and the stiffness of loads that follow the body; the
centrifugal force is a load of the equilibrium.  Lagrange multipliers of joints, rigid bodies and
beams remain unknowns: they have no mass, so that their eigenvalues are infinite.

Gas in closed films vibrates with them.  A vibration is fast, so that no gas flows and no heat is
exchanged: a change ΔV of the volume changes the pressure by -κ ΔV, κ = γ p/V, which adds the
stiffness κ g⊗g with the gradient g of the volume.  It couples all nodes of the film and is
therefore not in K; the formula of Sherman, Morrison and Woodbury adds it to the inverse:

    (A + U κ Uᵀ)⁻¹ = A⁻¹ - A⁻¹ U (κ⁻¹ + Uᵀ A⁻¹ U)⁻¹ Uᵀ A⁻¹,    U = (g of each chamber)         (2)

Contact keeps the pairs of the equilibrium, with the stiffness of their potential.

Modes near a frequency are found by inversion there (shift and invert) with SLEPc's Krylov-Schur
method:

    G = 0:   K φ = ω² M φ,   the largest eigenvalues θ = 1/(ω² - σ) of (K - σ M)⁻¹ M          (3)
    G ≠ 0:   see `vibration.turning_modes`

Count.  A Krylov method finds one vector of a multiple eigenvalue; further copies come by round-off
only, and may be left out.  At rest the modes that were found are therefore counted (`Spectrum`),
and copies that are missing are looked for with the others projected out, by I - Φ ΦᵀM.  By
Sylvester's law of inertia the pivots of K - σ M = L D Lᵀ have the signs of its eigenvalues: the
number of negative pivots is that of the eigenvalues ω² below σ.  The difference of two such numbers
is the number of modes between two shifts.  Lagrange multipliers add the same negative pivots at
every shift.  The stiffness of gas, Σ κ g⊗g, is the Schur complement of a larger matrix:

    [ A   U   ]
    [ Uᵀ -κ⁻¹ ]       n₋(A + U κ Uᵀ) = n₋(A) + n₋(-κ⁻¹ - Uᵀ A⁻¹ U) - n₋(-κ⁻¹)                 (4)

Cost.  One factorisation, of twice the size for a frequency other than zero in a turning frame, and
one solution with it for each Krylov vector.  The count takes one factorisation more for each of its
shifts, two as a rule.

Limits.  Modes are counted only if the stiffness is symmetric in the motions that constraints allow;
loads that follow an open film make it unsymmetric.

Source: of the count, the spectrum slicing of SLEPc (SLEPc Users Manual, section 3.4.5).
"""

from __future__ import annotations

import cmath
import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.analysis.vibration.rigid_motions import listed
from gossamer_fx.analysis.vibration.spectrum import (
    DIFFERENT_PATTERN,
    Spectrum,
    symmetric_on_constraints,
)
from gossamer_fx.core.checks.arguments import Range, check_arguments, collective, not_negative
from gossamer_fx.core.checks.errors import NoEquilibrium, check
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.loads.body_forces import Centrifugal
from gossamer_fx.records.outputs.static_records import ModeShape
from gossamer_fx.solve.solvers import factorisation
from gossamer_fx.solve.system.system import System

Shape = npt.NDArray[np.complex128]

AT_REST = (0.0, 0.0, 0.0)

# Rigid motions make K singular.  The shift is then moved from zero by this fraction of |K|/|M|,
# which is at most the square of the largest frequency, to where no mode is.
SHIFT_RATIO = 1e-12

# Tolerance of the eigenvalue solver, relative to the eigenvalue, and its largest number of
# restarts.
EIGENVALUE_TOLERANCE = 1e-9
MAX_RESTARTS = 500

# Shift over the square of a frequency of gas and film: (2) loses about as many digits as this has.
GAS_SHIFT_RATIO = 1e-4

# Squares of frequencies up to this multiple of the shift count as zero.
ZERO_FREQUENCY_FACTOR = 100.0

# Relative difference of the squares of frequencies below which they count as equal: some ten times
# what the eigenvalue solver leaves.
EQUAL_SQUARES = 1e-8

# Ratio of the eigenvalues of a Gram matrix below which its vectors count as dependent.
DEPENDENT = 1e-8

# Share of the kinetic energy of a mode from which on a body is named as one that moves in it.
MOVING_SHARE = 0.1

# Pseudo-step [s] in which dampers do not resist.
LONG_PSEUDO_STEP = 1e12

LOG = logging.getLogger("gossamer_fx")

# Relative difference of distances from `above`, up to which modes count as equally near to it: a
# thousand times what the eigenvalue solver leaves.
EQUAL_DISTANCES = 1e-6

# Searches for modes that a count misses: each finds at least one copy of every multiple eigenvalue.
MAX_SEARCHES = 10

# Spins count as equal up to this part of them.
SAME_SPIN = 1e-9


@check_arguments
@dataclass(frozen=True, repr=False)
class Mode(ModeShape):
    """A vibration q(t) = q0 + Re(φ e^(λt)) about an equilibrium q0.

    φ is scaled to the modal mass φᴴMφ = 1 kg; of a mode at rest it is real, with its largest
    component positive.  With the rigid motions r of the scene, translations along x, y, z and
    rotations about the axes through its centre of mass,

        participation     Γ = rᵀ M φ/(φᴴ M φ)
        effective mass    |rᵀ M φ|²/(φᴴ M φ)

    Over all modes at rest effective masses add up to the mass that the supports leave free.

    Attributes:
        frequency: [Hz], zero or positive.
        growth: [1/s]; positive for an equilibrium that is not stable.
        shape: this rank's part of φ, (unknowns of this rank,), a NumPy array of complex numbers; in
            the order of `system.unknowns.q0`, with multipliers behind the coordinates.
        displacements: the parts of φ at the nodes that this rank owns, (n, 3), by the names of the
            bodies; of beams and rigid bodies without the directors.
        participation: factors of translations and rotations about x, y, z, (2, 3); in the units
            that belong to φ.
        effective_mass: of translations along x, y, z, (3,) [kg].
        effective_inertia: of rotations about x, y, z through the centre of mass, (3,) [kg m²].

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> equilibrium = gx.Equilibrium(gx.Scene(weight, spring))
        >>> result = equilibrium.find()
        >>> bounce = gx.analysis.modes(equilibrium, 3)[2]
        >>> bounce.effective_mass.round(6), bounce.displacements["mass"].real.round(6)
        (array([0., 0., 1.]), array([[-0., -0.,  1.]]))
    """

    frequency: float
    growth: float
    shape: Shape
    displacements: Mapping[str, Shape] = field(default_factory=dict)
    participation: Shape = field(default_factory=lambda: np.zeros((2, 3), dtype=complex))
    effective_mass: Array = field(default_factory=lambda: np.zeros(3))
    effective_inertia: Array = field(default_factory=lambda: np.zeros(3))

    def __repr__(self) -> str:
        """Frequency, growth and effective masses; shapes are long."""
        x, y, z = self.effective_mass
        growth = ""
        if self.growth > 0:
            growth = f", grows by {self.growth:.4g}/s"
        masses = f"effective mass ({x:.3g}, {y:.3g}, {z:.3g}) kg"
        return f"<Mode: {self.frequency:.6g} Hz{growth}, {masses}>"


@check_arguments
@collective
def modes(
    equilibrium: Equilibrium,
    count: Annotated[int, Range(1)],
    *,
    spin: tuple[float, float, float] = AT_REST,
    above: Annotated[float, not_negative("Hz")] = 0.0,
) -> list[Mode]:
    """The `count` modes whose frequencies are nearest to `above`, in ascending order.

    Several modes may have one frequency, as those of a square or of a disc.  At rest, with a
    symmetric stiffness, the modes are counted, so that none is left out; a warning says if `count`
    cuts a group of one frequency.

    Args:
        equilibrium: the state about which the scene vibrates; `find` was called.
        count: number of modes.
        spin: ω of the frame [rad/s].  The scene then contains `Centrifugal` forces of the same
            spin on the bodies that turn.
        above: frequency [Hz], of which modes below count, too; the default finds the lowest modes.

    Raises:
        InputError: a value is out of its range, the scene has gas in a turning frame, no
            centrifugal force of the spin, or scalar unknowns other than gas, or no equilibrium was
            found.
        NoEquilibrium: the stiffness is singular, or the eigenvalue solver found fewer modes than
            there are.

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
    equilibrium.need("modes")
    spins = [item.spin for item in system.unknowns.items if isinstance(item, Centrifugal)]
    round_off = SAME_SPIN * float(np.linalg.norm(spin))
    check(
        not any(spin) or (bool(spins) and np.allclose(spins, spin, rtol=0, atol=round_off)),
        f"modes: spin is {spin!r} rad/s, but those of centrifugal forces are {spins or 'none'}; "
        "give each body that turns a loads.Centrifugal of this spin, and find the equilibrium.",
    )
    system.equations.set_inertia(0.0)
    if dissipates(system):
        # Dampers resist in the last pseudo-step of the search, which has an end.
        stand_still(system, LONG_PSEUDO_STEP)
    K = system.matrices.tangent()
    M = system.unknowns.M.copy()
    # Rows of fixed coordinates: 1 in K and 0 in M, so that their eigenvalues are infinite.
    system.unknowns.supports.clear(M, 0.0)
    least = round_off_square(K, M)
    away_from_zero = 0.0
    if not equilibrium.is_known_regular:
        away_from_zero = least
    ω = 2 * math.pi * above
    stiffnesses = gas_stiffnesses(system, is_turning=any(spin))
    if stiffnesses:
        # Without the gas K may be singular, so that (2) needs a shift that the gas does not hide.
        away_from_zero = max(away_from_zero, GAS_SHIFT_RATIO * _least_gas_square(M, stiffnesses))
    if not any(spin):
        found = _modes_at_rest(system, K, M, count, ω, ω**2 or -away_from_zero, stiffnesses, least)
    else:
        G = system.matrices.gyroscopic(spin)
        system.unknowns.supports.clear(G, 0.0)
        real_shift = 0.0 if ω else math.sqrt(away_from_zero)
        found = _modes_in_turning_frame(K, G, M, count, real_shift=real_shift, ω=ω)
    if len(found) < count:
        raise NoEquilibrium(
            f"Only {len(found)} of {count} modes converged; "
            "ask for fewer, or check the equilibrium."
        )

    nearest = sorted(found, key=lambda mode: _distance(mode, ω))[:count]
    _warn_of_zeros(equilibrium, nearest, least, M)
    if not any(spin):
        nearest = _orthogonal(nearest, M, least)
    masses = ModalMasses(system, M)
    complete = [masses.complete(mode, is_turning=any(spin)) for mode in nearest]
    _warn_of_growth(equilibrium, complete, least)
    return sorted(complete, key=lambda mode: (mode.frequency, -mode.growth))


def dissipates(system: System) -> bool:
    """Whether anything in a scene is damped."""
    return any(len(compiled.losses) > 0 for compiled in system.equations.compiled)


def stand_still(system: System, duration: float) -> None:
    """Let a system in equilibrium stand at the end of a pseudo-step [s] that goes nowhere, without
    inertia: its tangent is K + C/duration, with the matrix C of what is damped.  Collective."""
    time = system.unknowns.time
    system.unknowns.time = time - duration
    scalars = system.equations.begin_without_search(duration)
    system.unknowns.time = time
    system.equations.set_inertia(0.0)
    system.equations.set_end(system.unknowns.q0)
    residual = system.unknowns.numbering.vector()
    system.equations.residual(scalars, residual)
    residual.destroy()


def round_off_square(K: PETSc.Mat, M: PETSc.Mat) -> float:
    """Square of an angular frequency that round-off explains [rad²/s²].  Collective."""
    return float(SHIFT_RATIO * K.norm() / M.norm())


def _distance(mode: Mode, ω: float) -> float:
    """Distance of the eigenvalue λ of a mode from i ω [1/s]."""
    return math.hypot(mode.growth, 2 * math.pi * mode.frequency - ω)


def square_of(mode: Mode) -> float:
    """λ² [1/s²]: -ω² of a vibration, positive of a mode that grows."""
    return mode.growth**2 - (2 * math.pi * mode.frequency) ** 2


def _orthogonal(found: Sequence[Mode], M: PETSc.Mat, least: float) -> list[Mode]:
    """Modes at rest, with shapes of one frequency that are orthogonal with respect to the mass.
    `least` is the square of a frequency [rad²/s²] that is round-off; frequencies count as equal if
    their squares differ by up to `EQUAL_SQUARES` of them, or are near `least`.  Of several modes of
    one frequency the solver finds any independent combinations, whose effective masses do not add
    up.  Collective."""
    ordered = sorted(found, key=square_of)
    groups: list[list[Mode]] = []
    for mode in ordered:
        zero = ZERO_FREQUENCY_FACTOR * least
        is_equal = False
        if groups:
            before = square_of(groups[-1][-1])
            both_zero = max(abs(before), abs(square_of(mode))) <= zero
            difference = abs(square_of(mode) - before)
            is_equal = both_zero or difference <= EQUAL_SQUARES * abs(before)
        if is_equal:
            groups[-1].append(mode)
        else:
            groups.append([mode])
    result = []
    for group in groups:
        if len(group) > 1:
            result += _orthogonal_group(group, M)
        else:
            result += group
    return result


def _orthogonal_group(group: Sequence[Mode], M: PETSc.Mat) -> list[Mode]:
    """As many modes of one frequency with real shapes that are orthogonal with respect to the mass;
    the given ones if these are dependent.  Collective."""
    # Round-off may make a pair of complex conjugates of two real vectors of one eigenvalue.
    columns = [part for mode in group for part in (mode.shape.real, mode.shape.imag)]
    V = np.array(columns).T
    vector = M.createVecRight()
    product = M.createVecLeft()
    products = []
    for column in columns:
        vector.array[:] = column
        M.mult(vector, product)
        products.append(product.array_r.copy())
    own: Array = V.T @ np.array(products).T
    gram = M.comm.tompi4py().allreduce(own)
    squares, combinations = np.linalg.eigh(gram)
    kept = slice(len(columns) - len(group), None)
    if squares[kept][0] < DEPENDENT * squares[-1]:
        return list(group)
    shapes = V @ combinations[:, kept] / np.sqrt(squares[kept])
    return [replace(mode, shape=shapes[:, k].astype(complex)) for k, mode in enumerate(group)]


def gas_stiffnesses(system: System, is_turning: bool) -> list[tuple[Array, float]]:
    """The stiffness κ g⊗g that the gas gives each closed film: the derivative g (n,) [m²] of its
    volume by this rank's coordinates, zero where these are fixed, and κ [Pa/m³]."""
    found = []
    for scalars in system.equations.scalar_unknowns:
        stiffnesses = scalars.vibration_stiffness()
        check(
            stiffnesses is not None,
            "modes: the scene has scalar unknowns whose stiffness is not known here; "
            "leave them out.",
        )
        for gradient, stiffness in stiffnesses or ():
            values = gradient.copy()
            values[system.unknowns.supports.held] = 0.0
            found.append((values, stiffness))
    check(
        not (found and is_turning),
        "modes: the scene has gas chambers, whose stiffness is not known in a turning frame; "
        "give their pressure as Pressure, or leave spin out.",
    )
    return found


def _least_gas_square(M: PETSc.Mat, stiffnesses: Sequence[tuple[Array, float]]) -> float:
    """Smallest κ (g·g)²/(g·M g) of the closed films [1/s²]: the square of a frequency of gas and
    film."""
    comm = M.comm.tompi4py()
    squares = []
    for gradient, stiffness in stiffnesses:
        vector = M.createVecRight()
        vector.array[:] = gradient
        product = M.createVecLeft()
        M.mult(vector, product)
        length_squared = comm.allreduce(float(gradient @ gradient))
        mass = comm.allreduce(float(gradient @ product.array_r))
        if mass > 0:
            squares.append(stiffness * length_squared**2 / mass)
    return min(squares, default=0.0)


def _warn_of_zeros(
    equilibrium: Equilibrium, found: Sequence[Mode], least: float, M: PETSc.Mat
) -> None:
    """Warn of frequencies whose squares are up to `ZERO_FREQUENCY_FACTOR` times `least` [rad²/s²],
    which is round-off, unless the equilibrium is regular: slack film and free motions have them.
    Collective."""
    result = equilibrium.result
    assert result is not None
    limit = math.sqrt(ZERO_FREQUENCY_FACTOR * least) / (2 * math.pi)
    zeros = [mode for mode in found if mode.frequency <= limit]
    if not zeros or equilibrium.is_known_regular:
        return
    moved = _bodies_that_move(equilibrium.system, zeros, M)
    if equilibrium.comm.rank == 0:
        names = " and ".join(f"'{name}'" for name in moved)
        verb = "have" if len(moved) > 1 else "has"
        reason = (
            f"{names} {verb} no stiffness against them: slack film, or a turn or a slide that "
            "nothing holds"
        )
        if result.slack:
            reason = f"what is held is slack against {listed(result.slack)}"
        if result.free:
            reason = f"nothing resists {listed(result.free)}, or film is slack"
        LOG.warning(
            "modes: %d of %d frequencies are zero within round-off (below %.1e Hz), as %s; "
            "prestress the film, give it a residual stiffness, "
            "hold what is free, or ask for those near a higher frequency (`above`).",
            len(zeros),
            len(found),
            limit,
            reason,
        )


def _bodies_that_move(system: System, found: Sequence[Mode], M: PETSc.Mat) -> list[str]:
    """Names of the bodies with a share of at least `MOVING_SHARE` of the kinetic energy of one of
    the modes.  Collective."""
    vector = M.createVecRight()
    product = M.createVecLeft()
    own = np.zeros((len(found), len(system.unknowns.bodies)))
    for m, mode in enumerate(found):
        for part in (mode.shape.real, mode.shape.imag):
            vector.array[:] = part
            M.mult(vector, product)
            energies = part * product.array_r
            for k, body in enumerate(system.unknowns.bodies):
                own[m, k] += energies[system.unknowns.block(body).owned].sum()
    energies_of_bodies = M.comm.tompi4py().allreduce(own)
    shares = energies_of_bodies / energies_of_bodies.sum(axis=1, keepdims=True)
    is_moving = (shares >= MOVING_SHARE).any(axis=0)
    bodies = zip(system.unknowns.bodies, is_moving, strict=True)
    return [body.name for body, moves in bodies if moves]


def _warn_of_growth(equilibrium: Equilibrium, found: Sequence[Mode], least: float) -> None:
    """Warn of modes that grow, so that the equilibrium is not stable: whose squared growth is more
    than `ZERO_FREQUENCY_FACTOR` times `least` [1/s²], which is round-off.  Collective."""
    limit = math.sqrt(ZERO_FREQUENCY_FACTOR * least)
    growing = [mode for mode in found if mode.growth > limit]
    if not growing:
        return
    fastest = max(growing, key=lambda mode: mode.growth)
    largest = {}
    for name, displacements in fastest.displacements.items():
        own = float(np.abs(displacements).max(initial=0.0))
        largest[name] = equilibrium.comm.allreduce(own, op=MPI.MAX)
    if equilibrium.comm.rank == 0:
        LOG.warning(
            "modes: the equilibrium is not stable: %d of %d modes grow, the fastest by %.3g/s, "
            "which moves '%s' most; compress it less, or make it stiffer.",
            len(growing),
            len(found),
            fastest.growth,
            max(largest, key=lambda name: largest[name]),
        )


class ModalMasses:
    """Scales modes to unit modal mass of M, the mass matrix without fixed coordinates, and finds
    participation factors and effective masses at an equilibrium."""

    def __init__(self, system: System, M: PETSc.Mat) -> None:
        self._system = system
        self._M = M
        self._size = system.unknowns.block(system.unknowns.bodies[-1]).owned.stop
        self._momenta = self._rigid_momenta()

    def _rigid_momenta(self) -> Array:
        """M r of the six rigid motions, this rank's part (6, unknowns of this rank)."""
        system = self._system
        is_position = system.unknowns.position_marks
        q = system.unknowns.q0.array_r[: self._size].reshape(-1, 3)
        translations = [np.multiply.outer(is_position, axis) for axis in np.eye(3)]
        masses = [self._times_mass(self._M, r).reshape(-1, 3) for r in translations]
        # Mass and first moments of the whole scene, also where coordinates are fixed
        along_x = (
            self._times_mass(system.unknowns.M, translations[0]).reshape(-1, 3)[:, 0] * is_position
        )
        mass = self._sum(along_x)
        moments = [self._sum(along_x * q[:, i]) for i in range(3)]
        centre: Array = np.zeros(3)
        if mass > 0:
            centre = np.array(moments) / mass
        arms = q - np.multiply.outer(is_position, centre)
        turned = [np.cross(axis, arms) for axis in np.eye(3)]
        masses += [self._times_mass(self._M, r).reshape(-1, 3) for r in turned]
        return np.array(masses).reshape(6, -1)

    def _times_mass(self, M: PETSc.Mat, values: Array) -> Array:
        """A mass matrix times a vector of this rank's coordinates, of any shape; flattened."""
        vector = self._system.unknowns.numbering.vector()
        vector.array[: self._size] = values.ravel()
        product = M.createVecLeft()
        M.mult(vector, product)
        return np.array(product.array_r[: self._size])

    def _sum(self, values: Array) -> float:
        """Sum of the values of all ranks.  Collective."""
        return float(self._system.comm.allreduce(values.sum()))

    def complete(self, mode: Mode, is_turning: bool) -> Mode:
        """The mode with its shape scaled to unit modal mass, and with displacements, participation
        factors and effective masses; at rest the shape is turned to be real.  Collective."""
        comm = self._system.comm
        shape = mode.shape.copy()
        if not is_turning:
            shape = shape * np.conj(self._phase(shape))
        coordinates = shape[: self._size]
        momentum = self._times_mass(self._M, coordinates.real).astype(complex)
        momentum += 1j * self._times_mass(self._M, coordinates.imag)
        modal_mass = float(comm.allreduce(np.vdot(coordinates, momentum).real))
        if modal_mass > 0:
            shape /= math.sqrt(modal_mass)
        participation = comm.allreduce(self._momenta @ shape[: self._size]).reshape(2, 3)
        effective = np.abs(participation) ** 2
        displacements = {}
        for body in self._system.unknowns.bodies:
            of_nodes = shape[self._system.unknowns.block(body).owned].reshape(
                -1, body.block.size // 3, 3
            )
            displacements[body.name] = of_nodes[:, 0]
        return replace(
            mode,
            shape=shape,
            displacements=displacements,
            participation=participation,
            effective_mass=effective[0],
            effective_inertia=effective[1],
        )

    def _phase(self, shape: Shape) -> complex:
        """The factor of size one by which the largest component of a shape differs from a positive
        number."""
        coordinates = shape[: self._size]
        own = complex(0.0)
        if len(coordinates):
            own = complex(coordinates[np.abs(coordinates).argmax()])
        # Of components that are equal up to round-off the first rank's counts.
        largest = max(self._system.comm.allgather(own), key=abs)
        if largest == 0:
            return 1.0
        return largest / abs(largest)


class _ShiftedInverse:
    """The operator (K + Σ κ g⊗g - σ M)⁻¹ M of (3), by (2), as PETSc's Python matrix."""

    def __init__(
        self, K: PETSc.Mat, M: PETSc.Mat, σ: float, stiffnesses: Sequence[tuple[Array, float]]
    ) -> None:
        """Factorise K - σ M at a shift σ [rad²/s²], and solve with it for g of each chamber, see
        (2).  Collective."""
        shifted = K.copy()
        shifted.axpy(-σ, M, DIFFERENT_PATTERN)
        self._M = M
        self._Mx = M.createVecLeft()
        self._pc = PETSc.PC().create(K.comm)
        self._pc.setOperators(shifted)
        factorisation.choose(self._pc, shifted)
        _check_inverse(factorisation.set_up(self._pc))
        # Modes that are projected out, of unit modal mass, and M times these; rows of this rank.
        self._known: tuple[Array, Array] | None = None
        self._update: factorisation.LowRankUpdate | None = None
        if stiffnesses:
            self._update = factorisation.LowRankUpdate(shifted, stiffnesses, self._pc.apply)

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set y = (K + Σ κ g⊗g - σ M)⁻¹ M x, without its part along modes that are projected out;
        called by SLEPc."""
        self._M.mult(x, self._Mx)
        self._pc.apply(self._Mx, y)
        if self._update is not None:
            self._update.correct(y)
        if self._known is not None:
            shapes, momenta = self._known
            amounts = self._M.comm.tompi4py().allreduce(momenta.T @ y.array_r)
            y.array[:] -= shapes @ amounts

    def project_out(self, found: Sequence[Mode]) -> None:
        """Leave modes at rest that are orthogonal to each other, and no others, out of what later
        searches find.  Collective."""
        comm = self._M.comm.tompi4py()
        vector = self._M.createVecRight()
        shapes = []
        momenta = []
        for mode in found:
            vector.array[:] = mode.shape.real
            self._M.mult(vector, self._Mx)
            length = math.sqrt(comm.allreduce(float(vector.array_r @ self._Mx.array_r)))
            shapes.append(vector.array_r / length)
            momenta.append(self._Mx.array_r / length)
        self._known = (np.array(shapes).T, np.array(momenta).T)


def _check_inverse(problem: str) -> None:
    """Raise `NoEquilibrium` if a factorisation has failed."""
    if problem:
        raise NoEquilibrium(
            f"modes: the stiffness is singular at the frequency asked for, {problem}; "
            "choose another."
        )


def _modes_at_rest(
    system: System,
    K: PETSc.Mat,
    M: PETSc.Mat,
    count: int,
    ω: float,
    shift: float,
    stiffnesses: Sequence[tuple[Array, float]],
    least: float,
) -> list[Mode]:
    """The modes of equation (3) of the module that are nearest to the angular frequency ω [rad/s],
    and perhaps others.  The shift [rad²/s²] is near ω², with K - σ M regular; `least` [rad²/s²] is
    round-off.  Collective."""
    inverse = _ShiftedInverse(K, M, shift, stiffnesses)
    operator = PETSc.Mat().createPython(K.getSizes(), inverse, K.comm)
    operator.setUp()
    found = list(_search(operator, count, shift))
    if len(found) < count:
        return found
    with symmetric_on_constraints(system, K) as symmetric:
        if symmetric is None:
            return found
        spectrum = Spectrum(symmetric, M, stiffnesses)
        for _ in range(MAX_SEARCHES):
            missing = _missing(spectrum, found, count, ω, least)
            if not missing:
                break
            found = _orthogonal(found, M, least)
            inverse.project_out(found)
            found += _search(operator, missing, shift)
        else:
            raise NoEquilibrium(
                f"modes: {missing} modes below the last one were not found, "
                "though the stiffness has them; ask for more modes."
            )
    return found


def _search(operator: PETSc.Mat, count: int, shift: float) -> Iterator[Mode]:
    """Yield modes of (3) near a shift [rad²/s²], from the largest eigenvalues of the operator:
    `count` of them, or more or fewer as the solver has found; their shapes are not scaled."""
    for θ, shape in _largest_eigenpairs(operator, count):
        # ω² = shift + 1/θ, and the mode moves as exp(λ t) with λ² = -ω².  θ = 0 is that of an
        # infinite frequency, or of a mode that is projected out.
        if θ:
            λ = cmath.sqrt(-shift - 1 / θ)
            yield Mode(abs(λ.imag) / (2 * math.pi), growth=abs(λ.real), shape=shape)


def _missing(spectrum: Spectrum, found: Sequence[Mode], count: int, ω: float, least: float) -> int:
    """Number of modes nearer to the angular frequency ω [rad/s] than the last wanted one that were
    not found; warns if the wanted modes cut a group of one frequency.  Collective."""
    ordered = sorted(found, key=lambda mode: _distance(mode, ω))
    distances = [_distance(mode, ω) for mode in ordered]
    last = distances[count - 1]
    # Within round-off of zero there may be any number of modes, as of slack film or of a scene that
    # floats; of those only the modes above are counted that are nearer to ω.
    zero = ZERO_FREQUENCY_FACTOR * least
    if abs(square_of(ordered[count - 1])) <= zero:
        nearer = last * (1 - EQUAL_DISTANCES)
        highest = (ω + nearer) ** 2
        if highest <= zero:
            return 0
        above_zero = [mode for mode in ordered if -square_of(mode) > zero]
        known = sum(_distance(mode, ω) < nearer for mode in above_zero)
        return max(spectrum.count(zero, highest) - known, 0)
    within = spectrum.count(*_squares_within(ω, last * (1 + EQUAL_DISTANCES)))
    if within <= count:
        return 0
    nearer = last * (1 - EQUAL_DISTANCES)
    missing = spectrum.count(*_squares_within(ω, nearer)) - sum(d < nearer for d in distances)
    if missing > 0:
        return missing
    if spectrum.comm.rank == 0:
        LOG.warning(
            "modes: %d modes are cut from a group of %d of one frequency; ask for %d to have all.",
            count - sum(d < nearer for d in distances),
            within - sum(d < nearer for d in distances),
            within,
        )
    return 0


def _squares_within(ω: float, distance: float) -> tuple[float, float]:
    """Squares ω² [rad²/s²] between which the eigenvalues λ lie that are nearer to i ω than a
    distance [1/s]."""
    high = (ω + distance) ** 2
    if distance < ω:
        return (ω - distance) ** 2, high
    # Modes that grow have a real λ, |λ|² = distance² - ω².
    return ω**2 - distance**2, high


def _largest_eigenpairs(operator: PETSc.Mat, count: int) -> Iterator[tuple[complex, Shape]]:
    """Yield eigenvalues of largest magnitude, and this rank's parts of their vectors, by SLEPc: all
    that have converged, of which there may be more or fewer than `count`.  Collective."""
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
    K: PETSc.Mat, G: PETSc.Mat, M: PETSc.Mat, count: int, *, real_shift: float, ω: float
) -> list[Mode]:
    """The modes of equation (1) of the module whose eigenvalues λ are nearest to iω, or to a real
    shift [1/s] for ω = 0; of each conjugate pair the one with positive frequency.  They may be more
    than `count`, of which the caller takes the nearest, or fewer.  Collective."""
    # Imported here, as scenes at rest must not pay for it.
    from gossamer_fx.analysis.vibration.turning_modes import Inverse

    inverse = Inverse(K, G, M, real=real_shift, imaginary=ω)
    _check_inverse(inverse.problem)
    found = []
    # Both of each conjugate pair are found, and one more in case that a pair is divided.
    for _, z in _largest_eigenpairs(inverse.operator(), 2 * count + 2):
        λ, shape = inverse.pair(z)
        if λ.imag >= 0:
            found.append(Mode(λ.imag / (2 * math.pi), growth=λ.real, shape=shape))
    return found
