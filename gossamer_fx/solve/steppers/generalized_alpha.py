"""The generalised-α method: a second stepper on the same system, for comparison; it conserves
nothing."""

from __future__ import annotations

import logging
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated, Any

from petsc4py import PETSc

from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.checks.errors import NotConverged, check
from gossamer_fx.core.checks.lookups import check_no_contact
from gossamer_fx.mechanics.terms.discrete_gradient import EndPoint
from gossamer_fx.mechanics.terms.element_energies import ElementEnergies
from gossamer_fx.solve.solvers import factorisation
from gossamer_fx.solve.solvers.convergence import Tolerances
from gossamer_fx.solve.solvers.newton import Newton
from gossamer_fx.solve.steppers.stepping import Step, Stepper, StepSolver, check_step
from gossamer_fx.solve.system.system import System

LOG = logging.getLogger("gossamer_fx")

# Length over the first step of the trial step in which the first acceleration is computed: forces
# that depend on rates are differences over it, well above round-off, while positions hardly change.
TRIAL_STEP_RATIO = 1e-3


@check_arguments
@dataclass(frozen=True)
class GeneralizedAlpha(Stepper):
    """Generalised-α method (Chung & Hulbert, J. Appl. Mech. 60 (1993) 371, doi:10.1115/1.2900803).

    Second order in `dt`.  Equilibrium and constraints hold at the end of the step, and positions
    follow from an acceleration-like variable a, which differs from the acceleration dv/dt (Arnold &
    Brüls, Multibody Syst. Dyn. 18 (2007) 185, doi:10.1007/s11044-007-9084-0):

        M (dv/dt)_1 + f(q1) + De(q1)ᵀ λ1 = F1,   e(q1) = 0                                    (1)
        (1-α_m) a1 + α_m a0 = (1-α_f) (dv/dt)_1 + α_f (dv/dt)_0                               (2)
        q1 = q0 + h v0 + h² ((½-β) a0 + β a1)                                                 (3)
        v1 = v0 + h ((1-γ) a0 + γ a1)                                                         (4)

        α_m = (2ρ-1)/(ρ+1),  α_f = ρ/(ρ+1),  γ = ½ - α_m + α_f,  β = ¼ (1 - α_m + α_f)²       (5)

    The method loses or gains energy.  Damping, viscoelasticity and feedback are of first order
    only, as their rates are those of the step before its end; of viscoelasticity a warning says
    so.  The energy balance counts loads that vary within a step
    with their values at its end.

    Args:
        dt: step [s].
        spectral_radius: ρ in [0, 1] of high frequencies; 1 does not damp them, 0 annihilates them
            within a step.
        tolerances: when a step counts as solved.

    Raises:
        InputError: dt is not a positive number, or the spectral radius is not between 0 and 1; at
            the start of a run: the scene has contact or a latch.

    Example:
        >>> run = gx.Simulation(gx.Scene(hub), gx.GeneralizedAlpha(dt=0.1, spectral_radius=0.9))
        >>> run.run(until=1.0)
        >>> run.step
        10
    """

    dt: float
    spectral_radius: Annotated[float, Range(0.0, 1.0)] = 0.8
    _: KW_ONLY
    tolerances: Tolerances = field(default_factory=Tolerances)
    # The stress at the end of a step acts in it.
    rule = EndPoint()

    def __post_init__(self) -> None:
        check_step(self)

    def start(self, system: System) -> GeneralizedAlphaSolver:
        """The method at work on a compiled system, which has no contact and no latch."""
        # The work of the contact force at the end of a step is not the change of a contact energy:
        # a film that falls on a floor came back to three times its true height, and the energy
        # balance was open.
        check_no_contact(
            system,
            "GeneralizedAlpha",
            "in which this method neither conserves energy nor reports what it loses",
        )
        # Two bars that latch lost 0.24996 J instead of 0.25 J, and 5e-4 of their angular momentum.
        check(
            system.equations.constraints is None or not system.equations.constraints.can_switch,
            "GeneralizedAlpha: the scene has a latch, "
            "behind whose impact this method goes on with the accelerations before it; "
            "use Midpoint, or leave the latch out.",
        )
        relaxing = [
            name
            for kind in system.equations.compiled
            if isinstance(kind, ElementEnergies) and kind.relaxes
            for name in kind.losses
        ]
        if relaxing and system.comm.rank == 0:
            LOG.warning(
                "GeneralizedAlpha: the scene has viscoelasticity ('%s'), for which this method is "
                "of first order only; use Midpoint, or check the result with half of the step.",
                "', '".join(relaxing),
            )
        return GeneralizedAlphaSolver(system, self.spectral_radius, self.tolerances)


class GeneralizedAlphaSolver(StepSolver):
    """Makes steps of the generalised-α method on a compiled system, one at a time; its history
    variables are the vectors a0 and (dv/dt)_0 of (2)."""

    def __init__(self, system: System, ρ: float, tolerances: Tolerances) -> None:
        self._system = system
        # Weights of the method, all dimensionless, see (5) of `GeneralizedAlpha`: α_m and α_f of
        # accelerations in (2), γ and β of the acceleration at the end in (4) and (3).
        self._α_m = (2 * ρ - 1) / (ρ + 1)
        self._α_f = ρ / (ρ + 1)
        self._γ = 0.5 - self._α_m + self._α_f
        self._β = (1 - self._α_m + self._α_f) ** 2 / 4
        # a is the acceleration at a time that is later by (α_m - α_f) h.  With (3) the error of q1
        # is C h³ times the third derivative, C from 1/12 for ρ = 1 to 1/3 for ρ = 0.
        self.error_constant = abs((self._α_m - self._α_f) / 2 + self._β - 1 / 6)
        self.newton = Newton(system, tolerances)
        # Distributed vectors of all unknowns.  a0 and a1 [m/s²] are the acceleration-like variable
        # at the start and the end of a step, v1 [m/s] the velocity at its end.
        self._a0 = system.unknowns.numbering.vector()
        self._a1 = system.unknowns.numbering.vector()
        # dv/dt at both ends.
        self._rate0 = system.unknowns.numbering.vector()
        self._rate1 = system.unknowns.numbering.vector()
        self._v1 = system.unknowns.numbering.vector()
        # Predicted increment of the coordinates [m], and the offset [m] of the inertia force.
        self._increment = system.unknowns.numbering.vector()
        self._offset = system.unknowns.numbering.vector()
        # The names are part of the format of checkpoint files.
        self.vectors = {"acceleration": self._a0, "rate": self._rate0}
        self._has_acceleration = False

    def get_history(self) -> dict[str, Any]:
        return {"started": self._has_acceleration}

    def set_history(self, state: dict[str, Any]) -> None:
        self._has_acceleration = state["started"]

    def step(self, h: float) -> Step:
        """Solve for the correction w [m] of the predicted increment, from which accelerations and
        the velocity v1 at the end of the step follow.  The first call computes the initial
        acceleration, from the state that the system has then."""
        if not self._has_acceleration:
            self._compute_first_acceleration(h)
        system = self._system
        # The vector of unknowns in which the iteration starts.
        y = system.equations.begin_step(h)
        self._predict(h)
        w, _, iterations = self.newton.solve(self._increment, y)
        self._rate1.waxpy(1.0, w, self._offset)
        self._rate1.scale(self._inertia(h))
        self._a1.waxpy(1 / (self._β * h**2), w, self._a0)
        self._clear_multipliers(self._rate1)
        self._clear_multipliers(self._a1)
        # v1 of (4)
        self._v1.waxpy(h * (1 - self._γ), self._a0, system.unknowns.v0)
        self._v1.axpy(h * self._γ, self._a1)
        ends = {"acceleration": self._a1, "rate": self._rate1}
        return Step(h, self._v1, iterations, ends)

    def _inertia(self, h: float) -> float:
        """c [1/s²], the derivative of (dv/dt)_1 with respect to q1 by (2) and (3)."""
        return (1 - self._α_m) / ((1 - self._α_f) * self._β * h**2)

    def _predict(self, h: float) -> None:
        """Express the update of the generalised-α method in w, the correction of the predicted
        increment, for a step of length h [s].

            q1 - q0 = h v0 + h² a0/2 + w,    a1 = a0 + w/(β h²),    (dv/dt)_1 = c (w + offset)

        It overwrites the vectors of the increment h v0 + h² a0/2 [m] and of the offset [m], and
        gives the system the inertia force c M (w + offset) [N].
        """
        system = self._system
        c = self._inertia(h)
        α_m = self._α_m
        α_f = self._α_f
        self._a0.copy(self._increment)
        self._increment.scale(h**2 / 2)
        self._increment.axpy(h, system.unknowns.v0)
        self._a0.copy(self._offset)
        self._offset.scale(self._β * h**2 + α_m / (1 - α_f) / c)
        self._offset.axpy(-α_f / (1 - α_f) / c, self._rate0)
        system.equations.set_inertia(c, self._offset)

    # ---- the first acceleration ------------------------------------------------------------------

    def _compute_first_acceleration(self, h: float) -> None:
        """Solve for the acceleration dv/dt [m/s²] of the initial state, and set a0 to it.
        Collective.

            M dv/dt + De(q0)ᵀ λ = F - f(q0, v0)
            De(q0) dv/dt = -D²e[v0, v0]      (constraints differentiated twice)

        with the mass matrix M [kg], constraints e = 0 and their multipliers λ, loads F [N] and
        internal forces f [N].  Forces that depend on rates are evaluated in a trial step with the
        initial velocity v0 of a thousandth of h [s].  The increment vector is overwritten, as space
        for the right side. If the matrix is singular the next call tries again.
        """
        system = self._system
        # r [N] is the residual, then the right side; A the matrix of both equations.
        r = self._increment
        A = system.unknowns.M.copy()
        self._evaluate_trial_step(TRIAL_STEP_RATIO * h, r)
        if system.equations.constraints:
            with r as values:
                values[system.equations.constraints.owned] = 0
            system.equations.constraints.add_curvature(system.unknowns.v0, r)
            system.equations.constraints.add_tangents(A)
            A.assemble()
        # Unit rows give fixed coordinates the acceleration zero.
        system.unknowns.supports.clear(A, 1.0)
        r.scale(-1.0)
        problem = factorisation.solve(A, r, self._rate0)
        if problem:
            raise NotConverged(f"no acceleration to start with, {problem}")
        self._clear_multipliers(self._rate0)
        self._rate0.copy(self._a0)
        self._has_acceleration = True

    def _evaluate_trial_step(self, h: float, r: PETSc.Vec) -> None:
        """Set r to the residual without inertia [N] of a trial step of length h [s], to q0 + h v0,
        but for fixed and prescribed coordinates.  Collective.

        The step is not committed; the system retains the iterate and an inertia of zero until the
        next step begins.
        """
        system = self._system
        system.equations.set_inertia(0.0)
        y = system.equations.begin_step(h)
        system.unknowns.v0.copy(r)
        r.scale(h)
        fixed_values = system.equations.predict(r)
        r.zeroEntries()
        # w [m], the correction of the predicted increment: zero where coordinates are free.
        with r as w:
            w[system.unknowns.supports.held] = fixed_values
        system.equations.set_increment(r, None)
        system.equations.residual(y, r)

    def _clear_multipliers(self, rate: PETSc.Vec) -> None:
        """Set the entries of Lagrange multipliers to zero: they have no rate."""
        if self._system.equations.constraints:
            with rate as values:
                values[self._system.equations.constraints.owned] = 0
