"""Vibrations about an equilibrium in the coordinates of its modes, for forced responses.

With shapes φ_k, loads f = Re(f̂ e^(iωt)) and displacements x = Re(x̂ e^(iωt)),

    x̂ = Σ y_k φ_k,    D(ω) y = Φᵀ f̂                                                            (1)
    D_kl = [k_k (1 + iη) + 2i ζ_k ω √(k_k m_k) - ω² m_k] δ_kl + iω φ_k·C φ_l                   (2)

k_k = φ_k·K φ_k and m_k = φ_k·M φ_k, where M and K are diagonal.  η is the loss factor of the whole
scene, ζ_k are damping ratios, and C is the damping of its dampers and damped bodies.

The shapes are the modes, and static displacements under what these do not carry of the load and of
the forces C φ_k of the dampers (residual vectors),

    K r = g - M Φ Φᵀ g,    g = f̂ or C φ_k                                                      (3)

They are orthogonal to the modes by M and K, and combined so that they are to each other.  A static
response is then exact with any number of modes, and the others far below the modes that are left
out.

The ground may move with an acceleration a = Re(â e^(iωt)).  Seen from the ground that is the load
-M t â with the translation t; all x̂ are then displacements relative to the ground.

C follows from two tangents of the scene at rest, K + C/h for pseudo-steps of different length h:
dampers resist there, and nothing else depends on h.

The gas of closed films vibrates with them, see `natural_modes`; its stiffness is in ω_k and K.

Source: of residual vectors, J. M. Dickens, J. M. Nakagawa & M. J. Wittbrodt, Computers & Structures
62 (1997) 985, doi:10.1016/S0045-7949(96)00315-X.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.analysis.sensitivity.objectives import add_gas_pressures
from gossamer_fx.analysis.sensitivity.static_solver import StaticSolver
from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.analysis.vibration.natural_modes import (
    LONG_PSEUDO_STEP,
    ZERO_FREQUENCY_FACTOR,
    Mode,
    dissipates,
    gas_stiffnesses,
    round_off_square,
    square_of,
    stand_still,
)
from gossamer_fx.analysis.vibration.spectrum import symmetric_on_constraints
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.loads.body_forces import Centrifugal
from gossamer_fx.records.probes.objective import ForceObjective, Objective
from gossamer_fx.solve.system.system import System

Complex = npt.NDArray[np.complex128]

# Residual vectors whose energy is less than this share of that of all static displacements are
# round-off, or follow from others.
NEGLIGIBLE_ENERGY = 1e-12

# Largest |φ·M φ - 1| of a mode of the equilibrium: modes of another one are refused.
MASS_TOLERANCE = 1e-6


class ModalModel:
    """The equations (1) to (3) of an equilibrium.

    Args:
        equilibrium: found, at rest and stable.
        modes: from `analysis.modes` of this equilibrium.
        loss_factor: η.
        damping_ratio: ζ, of all modes or of each.
        what: the public function that needs the model, for messages.

    Raises:
        InputError: what (1) does not hold for: a scene that turns, that relaxes or whose loads make
            the stiffness unsymmetric, modes that grow, or modes of another equilibrium.

    All methods are collective.
    """

    def __init__(
        self,
        equilibrium: Equilibrium,
        modes: Sequence[Mode],
        *,
        loss_factor: float,
        damping_ratio: float | Sequence[float],
        what: str,
    ) -> None:
        equilibrium.need(what)
        self._equilibrium = equilibrium
        self._system = system = equilibrium.system
        self._what = what
        self._loss_factor = loss_factor
        ratios = np.atleast_1d(np.asarray(damping_ratio, dtype=float))
        check(
            len(ratios) in (1, len(modes)) and bool((ratios >= 0).all()),
            f"{what}: damping_ratio has {len(ratios)} numbers, the least {ratios.min():g}, for "
            f"{len(modes)} modes; give one number or one for each mode, not below zero.",
        )
        self._ratios: Array = np.broadcast_to(ratios, (len(modes),))
        self._refuse_unsupported()
        size = system.unknowns.numbering.size_local
        is_of_scene = all(len(mode.shape) == size for mode in modes)
        check(
            bool(system.comm.allreduce(int(not is_of_scene)) == 0),
            f"{what}: the modes are those of another scene; give modes of this equilibrium.",
        )
        # Φ (unknowns of this rank, n), zero at fixed coordinates.
        self._shapes: Array = np.array([mode.shape.real for mode in modes]).T
        self._shapes[system.unknowns.supports.held] = 0.0
        # Times M: (unknowns of this rank, n).
        self._M = system.unknowns.M.copy()
        system.unknowns.supports.clear(self._M, 0.0)
        self._momenta = _products(self._M, self._shapes)
        self._check_masses()
        self._damping = self._damping_forces(self._shapes)
        self._gas = gas_stiffnesses(system, is_turning=False)
        self._solver = StaticSolver(system)
        self._solver.factorise(equilibrium.is_known_regular, self._gas)
        K = system.matrices.tangent()
        with symmetric_on_constraints(system, K) as symmetric:
            check(
                symmetric is not None,
                f"{what}: loads make the stiffness unsymmetric, so that modes do not uncouple the "
                "vibrations; hold the rim of what is under pressure.",
            )
        self._squares = self._checked_squares(modes, round_off_square(K, self._M))

    def _refuse_unsupported(self) -> None:
        """Raise `InputError` for items by which vibrations are not those of (1)."""
        # Imported here, as scenes without it must not pay for it.
        from gossamer_fx.mechanics.loads.internal_friction import InternalFriction
        from gossamer_fx.mechanics.loads.viscoelasticity import Viscoelasticity

        for item in self._system.unknowns.items:
            name = getattr(item, "name", type(item).__name__)
            check(
                not isinstance(item, Centrifugal),
                f"{self._what}: the scene turns by '{name}', so that Coriolis forces couple its "
                "modes; the response of turning scenes is not supported, integrate it in time.",
            )
            check(
                not isinstance(item, Viscoelasticity),
                f"{self._what}: '{name}' relaxes, so that the stiffness depends on the frequency; "
                "leave it out of the scene, and give its loss_factor.",
            )
            check(
                not isinstance(item, InternalFriction),
                f"{self._what}: '{name}' sticks and slides, so that stiffness and loss depend on "
                "the amplitude; leave it out of the scene, and give the loss_factor of its cycle, "
                "or integrate in time.",
            )

    def _check_masses(self) -> None:
        """Raise `InputError` unless the modes have unit modal masses."""
        masses = self._system.comm.allreduce(np.sum(self._shapes * self._momenta, axis=0))
        check(
            bool((np.abs(masses - 1) < MASS_TOLERANCE).all()),
            f"{self._what}: the modes are not those of this equilibrium, as their modal masses are "
            f"{masses.min():.6g} to {masses.max():.6g} kg and not 1; give what gx.analysis.modes "
            "has found for it, at rest.",
        )

    def _checked_squares(self, modes: Sequence[Mode], least: float) -> Array:
        """ω_k² (n,), zero up to round-off, of which `least` [rad²/s²] is a part; `InputError` if a
        mode grows."""
        squares = np.array([-square_of(mode) for mode in modes])
        zero = ZERO_FREQUENCY_FACTOR * least
        check(
            bool((squares >= -zero).all()),
            f"{self._what}: mode {int(squares.argmin()) + 1} grows, as the equilibrium is not "
            "stable; its response has no amplitude, find a stable equilibrium.",
        )
        squares[np.abs(squares) <= zero] = 0.0
        return squares

    def _damping_forces(self, shapes: Array) -> Array:
        """C times shapes (unknowns of this rank, n) [N s/m].  The system stands in a pseudo-step of
        the length `LONG_PSEUDO_STEP` then."""
        system = self._system
        forces = np.zeros_like(shapes)
        if not dissipates(system):
            stand_still(system, LONG_PSEUDO_STEP)
            return forces
        # One second: the difference of both tangents is C itself.
        stand_still(system, 1.0)
        forces += _products(system.matrices.tangent(), shapes)
        stand_still(system, LONG_PSEUDO_STEP)
        forces -= _products(system.matrices.tangent(), shapes)
        forces[system.unknowns.supports.held] = 0.0
        return forces

    # ---- excitation ------------------------------------------------------------------------------

    def forces_of(self, items: Iterable[Any]) -> Array:
        """Forces (unknowns of this rank,) [N] of loads that need not be in the scene, in the
        equilibrium and at its time, also on fixed coordinates."""
        system = self._system
        residual = system.unknowns.numbering.vector()
        kinds: dict[Any, list[Term]] = {}
        for item in items:
            terms = list(item.terms(system.unknowns.state))
            name = getattr(item, "name", type(item).__name__)
            for term in terms:
                kinds.setdefault(term.compiler, []).append(term)
            compilers: list[Any] = [term.compiler for term in terms]
            is_load = bool(terms) and all(kind.is_external_load for kind in compilers)
            check(
                is_load,
                f"{self._what}: '{name}' ({type(item).__name__}) is not a load; give a Pressure, "
                "Gravity, loads.Force or the like.",
            )
            bodies = [getattr(term, "body", None) for term in terms]
            foreign = [body for body in bodies if body and body not in system.unknowns.bodies]
            check(
                not foreign,
                f"{self._what}: '{name}' acts on a body that is not in the scene of the "
                "equilibrium; add it.",
            )
        for kind, terms in kinds.items():
            for compiled in kind.compile(terms, system.unknowns):
                compiled.begin_step(system.unknowns.time)
                compiled.update(False)
                compiled.add_forces(residual)
        residual.assemble()
        forces = -residual.array_r
        residual.destroy()
        return np.asarray(forces)

    def translation(self, direction: Sequence[float]) -> Array:
        """The translation of the whole scene (unknowns of this rank,), supports included, by a
        vector; directors and multipliers do not change."""
        marks = self._system.unknowns.position_marks
        translation = np.zeros(len(self._shapes))
        moved = np.multiply.outer(marks, np.asarray(direction, dtype=float))
        translation[: moved.size] = moved.ravel()
        return translation

    def inertia_of(self, translation: Array) -> Array:
        """Forces (unknowns of this rank,) [N] of the inertia in a motion of the ground with this
        acceleration [m/s²], as seen from the ground."""
        vector = self._system.unknowns.numbering.vector()
        product = self._system.unknowns.numbering.vector()
        vector.array[:] = translation
        # With the columns of fixed coordinates, which move along.
        self._system.unknowns.M.mult(vector, product)
        forces = -product.array_r
        for each in (vector, product):
            each.destroy()
        return forces

    # ---- shapes ----------------------------------------------------------------------------------

    def response_to(self, loads: Array) -> ModalResponse:
        """The shapes that respond to loads (unknowns of this rank,) [N], and their matrices."""
        comm = self._system.comm
        forces = loads.copy()
        forces[self._system.unknowns.supports.held] = 0.0
        residuals, stiffness, mass = self._residual_vectors(forces)
        shapes = np.column_stack([self._shapes, residuals])
        damping = np.column_stack([self._damping, self._damping_forces(residuals)])
        modal_forces = comm.allreduce(shapes.T @ forces)
        # What is round-off compared with the others excites nothing.
        largest = float(np.abs(modal_forces).max(initial=0.0))
        modal_forces[np.abs(modal_forces) <= np.finfo(float).eps * largest] = 0.0
        return ModalResponse(
            system=self._system,
            what=self._what,
            shapes=shapes,
            modes=len(self._squares),
            stiffness=np.concatenate([self._squares, stiffness]),
            mass=np.concatenate([np.ones(len(self._squares)), mass]),
            viscous=comm.allreduce(shapes.T @ damping),
            # Nobody knows the damping of what is beyond the modes: that of the last one.
            ratios=np.concatenate([self._ratios, np.full(len(mass), self._ratios[-1])]),
            loss_factor=self._loss_factor,
            forces=modal_forces,
            loads=loads,
            gas=self._gas,
        )

    def linear(self, forces: Array, probes: Sequence[Objective]) -> LinearModes:
        """The modes alone as a linear system for m inputs with the forces (unknowns of this rank,
        m) [N] of their units, and k probes."""
        comm = self._system.comm
        for probe in probes:
            check(
                not isinstance(probe, ForceObjective),
                f"{self._what}: a {type(probe).__name__} also depends on accelerations, which a "
                "linear system does not give; take harmonic_response, or ask for positions.",
            )
        forces = forces.copy()
        forces[self._system.unknowns.supports.held] = 0.0
        n = len(self._squares)
        derivatives = [_derivatives(self._system, self._gas, probe) for probe in probes]
        seen = np.array([np.array(pair) @ self._shapes for pair in derivatives])
        seen = comm.allreduce(seen.reshape(-1, 2, n))
        viscous = comm.allreduce(self._shapes.T @ self._damping)
        # A loss factor is a damping ratio of half of it at each resonance.
        ratios = self._ratios + self._loss_factor / 2
        of_modes = comm.allreduce(self._shapes.T @ forces)
        rest = forces - self._momenta @ of_modes
        beyond = np.zeros((len(probes), forces.shape[1]))
        for column, g in enumerate(rest.T):
            displacement, is_solved = self._static_displacement(g)
            self._refuse_unresisted(is_solved)
            beyond[:, column] = [by_position @ displacement for by_position, _ in derivatives]
        return LinearModes(
            squares=self._squares,
            damping=viscous + np.diag(2 * ratios * np.sqrt(self._squares)),
            forces=of_modes,
            by_position=seen[:, 0],
            by_velocity=seen[:, 1],
            beyond=comm.allreduce(beyond),
        )

    def _refuse_unresisted(self, is_resisted: bool) -> None:
        check(
            is_resisted,
            f"{self._what}: a load pushes along a motion that nothing resists and that is not "
            "among the modes; hold it, or ask gx.analysis.modes for more of them.",
        )

    def _residual_vectors(self, forces: Array) -> tuple[Array, Array, Array]:
        """Residual vectors r (unknowns of this rank, m) of (3), with r·K r = 1 each, these ones
        (m,), and r·M r (m,)."""
        comm = self._system.comm
        found = []
        carried = []
        energies = []
        for k, g in enumerate([forces, *self._damping.T]):
            of_modes = comm.allreduce(self._shapes.T @ g)
            rest = g - self._momenta @ of_modes
            displacement, is_solved = self._static_displacement(rest)
            self._refuse_unresisted(is_solved or k > 0)
            stiff = self._squares > 0
            energy = float(np.sum(of_modes[stiff] ** 2 / self._squares[stiff]))
            own = comm.allreduce(float(displacement @ rest))
            if is_solved and own > NEGLIGIBLE_ENERGY * (energy + own):
                found.append(displacement / math.sqrt(energy + own))
                carried.append(rest / math.sqrt(energy + own))
                energies.append(own / (energy + own))
        if not found:
            return np.zeros((len(forces), 0)), np.zeros(0), np.zeros(0)
        r = np.array(found).T
        K = comm.allreduce(r.T @ np.array(carried).T)
        M = comm.allreduce(r.T @ _products(self._M, r))
        # Combinations with the energies 1/2, without those that follow from others.
        values, vectors = np.linalg.eigh((K + K.T) / 2)
        kept = values > NEGLIGIBLE_ENERGY * max(energies)
        vectors = vectors[:, kept] / np.sqrt(values[kept])
        masses, turned = np.linalg.eigh(vectors.T @ (M + M.T) @ vectors / 2)
        shapes: Array = r @ vectors @ turned
        return shapes, np.ones(len(masses)), np.maximum(masses, 0.0)

    def _static_displacement(self, forces: Array) -> tuple[Array, bool]:
        """K⁻¹ f (unknowns of this rank,) less its part in the modes, and whether there is one."""
        right_side = self._system.unknowns.numbering.vector()
        solution = self._system.unknowns.numbering.vector()
        right_side.array[:] = forces
        is_solved = self._solver.solve(right_side, solution)
        amounts = self._system.comm.allreduce(self._momenta.T @ solution.array_r)
        found: Array = solution.array_r - self._shapes @ amounts
        for each in (right_side, solution):
            each.destroy()
        return found, is_solved


@dataclass(frozen=True, eq=False)
class LinearModes:
    """n modes of unit mass under m inputs, seen by k probes.

    Attributes:
        squares: ω² (n,) [1/s²].
        damping: Δ (n, n) [1/s].
        forces: Φᵀ F (n, m).
        by_position, by_velocity: what each probe sees of a mode, and of its rate (k, n).
        beyond: static response of what is beyond the modes (k, m).
    """

    squares: Array
    damping: Array
    forces: Array
    by_position: Array
    by_velocity: Array
    beyond: Array


def _products(matrix: PETSc.Mat, shapes: Array) -> Array:
    """A matrix times shapes (unknowns of this rank, n).  Collective."""
    vector = matrix.createVecRight()
    product = matrix.createVecLeft()
    found = np.zeros_like(shapes)
    for k, shape in enumerate(shapes.T):
        vector.array[:] = shape
        matrix.mult(vector, product)
        found[:, k] = product.array_r
    for each in (vector, product):
        each.destroy()
    return found


@dataclass(frozen=True)
class ModalResponse:
    """The equations (1) and (2) for one load.

    Attributes:
        system: of the equilibrium.
        what: the public function that needs it, for messages.
        shapes: modes, then residual vectors (unknowns of this rank, N).
        modes: number of the modes.
        stiffness, mass: k and m (N,).
        viscous: φ_k·C φ_l (N, N).
        ratios: ζ (N,).
        loss_factor: η.
        forces: Φᵀ f̂ (N,).
        loads: f̂ (unknowns of this rank,), also on fixed coordinates.
        gas: stiffnesses of gas, see `natural_modes`.
    """

    system: System
    what: str
    shapes: Array
    modes: int
    stiffness: Array
    mass: Array
    viscous: Array
    ratios: Array
    loss_factor: float
    forces: Array
    loads: Array
    gas: Sequence[tuple[Array, float]]

    @property
    def has_rigid_motions(self) -> bool:
        """Whether a mode has the frequency zero."""
        return bool((self.stiffness == 0).any())

    @property
    def frequencies(self) -> Array:
        """Frequencies of the shapes [Hz], (N,), infinite of a residual vector without mass."""
        infinite = np.full(len(self.mass), math.inf)
        squares = np.divide(self.stiffness, self.mass, out=infinite, where=self.mass > 0)
        found: Array = np.sqrt(squares) / (2 * math.pi)
        return found

    @property
    def bandwidths(self) -> Array:
        """Half of the width of the resonances [Hz], (N,): about the damping ratio times the
        frequency; zero of what has none."""
        ω = 2 * math.pi * np.where(np.isfinite(self.frequencies), self.frequencies, 0.0)
        mass = np.where(self.mass > 0, self.mass, 1.0)
        viscous = np.abs(np.diag(self.viscous)) / mass
        found: Array = (2 * self.ratios * ω + self.loss_factor * ω + viscous) / (4 * math.pi)
        return found

    def amplitudes(self, frequencies: Array) -> Complex:
        """y (m, N) at frequencies (m,) [Hz]; `InputError` at the resonance of a mode without
        damping."""
        ω = 2 * math.pi * frequencies
        own: Any = self.stiffness * (1 + 1j * self.loss_factor) - ω[:, None] ** 2 * self.mass
        own += 2j * self.ratios * np.sqrt(self.stiffness * self.mass) * ω[:, None]
        own += 1j * np.multiply.outer(ω, np.diag(self.viscous))
        at_resonance = np.argwhere((own == 0) & (self.forces != 0))
        if len(at_resonance):
            row, mode = at_resonance[0]
            raise InputError(
                f"{self.what}: at {frequencies[row]:.6g} Hz the response of mode {mode + 1} has "
                "no bound; give a loss_factor or damping_ratio, or another frequency."
            )
        coupled = self.viscous - np.diag(np.diag(self.viscous))
        if not coupled.any():
            excited = np.where(self.forces == 0, 1.0, own)
            return np.asarray(self.forces / excited, dtype=complex)
        D = 1j * np.multiply.outer(ω, coupled)
        D[:, range(len(self.mass)), range(len(self.mass))] += own
        right_sides = np.broadcast_to(self.forces[:, None], (len(ω), len(self.mass), 1))
        return np.asarray(np.linalg.solve(D, right_sides)[:, :, 0])

    def seen(self, probe: Objective, frequencies: Array, amplitudes: Complex) -> Complex:
        """Complex amplitudes (m,) of a probe at frequencies (m,) [Hz], of y (m, N).  Collective."""
        ω = 2 * math.pi * frequencies
        if not isinstance(probe, ForceObjective):
            rows = self.rows(probe)
            return np.asarray(amplitudes @ rows[0] + 1j * ω * (amplitudes @ rows[1]))
        by_position, _ = _derivatives(self.system, self.gas, probe)
        # What supports hold bears the damping and the inertia of its nodes, too.
        weights = probe.residual_weights(self.system)
        inertia = weights.duplicate()
        self.system.unknowns.M.mult(weights, inertia)
        rows = self._of_shapes([by_position, self._damping_at(weights), inertia.array_r])
        comm = self.system.comm
        constant = -comm.allreduce(float(weights.array_r @ self.loads))
        for each in (weights, inertia):
            each.destroy()
        stiff = (1 + 1j * self.loss_factor) * (amplitudes @ rows[0])
        viscous = 1j * ω * (amplitudes @ rows[1])
        return np.asarray(stiff + viscous - ω**2 * (amplitudes @ rows[2]) + constant)

    def rows(self, probe: Objective) -> Array:
        """What a probe sees of each shape, (2, N): by positions, and by velocities.  Collective."""
        return self._of_shapes(list(_derivatives(self.system, self.gas, probe)))

    def seen_of(self, probe: Objective, motion: Array) -> float:
        """What a probe sees of a translation of the ground (unknowns of this rank,); nothing if it
        is a force.  Collective."""
        if isinstance(probe, ForceObjective):
            return 0.0
        by_position, _ = _derivatives(self.system, self.gas, probe)
        return float(self.system.comm.allreduce(float(by_position @ motion)))

    def _of_shapes(self, rows: Sequence[Array]) -> Array:
        """Products (n, N) of rows (unknowns of this rank,) with the shapes."""
        found: Array = self.system.comm.allreduce(np.array(rows) @ self.shapes)
        return found

    def _damping_at(self, weights: PETSc.Vec) -> Array:
        """Cᵀ w (unknowns of this rank,) of weights of held coordinates."""
        system = self.system
        found = np.zeros(weights.local_size)
        if not dissipates(system):
            return found
        product = weights.duplicate()
        for sign, duration in ((1.0, 1.0), (-1.0, LONG_PSEUDO_STEP)):
            stand_still(system, duration)
            system.matrices.tangent_with_supports().multTranspose(weights, product)
            found += sign * product.array_r
        product.destroy()
        return found


def _derivatives(
    system: System, gas: Sequence[tuple[Array, float]], probe: Objective
) -> tuple[Array, Array]:
    """Derivatives of a probe by positions and velocities (unknowns of this rank,), with those of
    the pressures of gas.  Collective."""
    by_position = system.unknowns.numbering.vector()
    by_velocity = system.unknowns.numbering.vector()
    probe.add_derivative(system, by_position, by_velocity)
    add_gas_pressures(probe, system, gas, by_position)
    found = by_position.array_r.copy(), by_velocity.array_r.copy()
    for each in (by_position, by_velocity):
        each.destroy()
    return found
