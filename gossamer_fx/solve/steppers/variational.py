"""The variational midpoint rule: the discrete Euler-Lagrange equations of a discrete action.

Problem.  The conserving rule needs the mean stress over the path between two strains, for which a
law must know where its state switches, and its tangent is not symmetric.

Idea.  Hamilton's principle for a sum of discrete Lagrangians, each the quadrature of the Lagrangian
L = ½ v·M v - ψ(e(q)) in the middle of a step:

    L_d(q0, q1) = h L(q_mid, (q1 - q0)/h),    q_mid = (q0 + q1)/2                             (1)
    D2 L_d(q0, q1) + D1 L_d(q1, q2) = 0                                                       (2)

With the momenta M v0 = -D1 L_d(q0, q1) and M v1 = D2 L_d(q0, q1) of the discrete Legendre
transform, (2) says that v1 of one step is v0 of the next, and

    (q1 - q0)/h = (v0 + v1)/2
    M (v1 - v0)/h + De(q_mid)ᵀ ψ'(e(q_mid)) = F_mid                                           (3)

These are the equations of `Midpoint` with another stress, that of the strain e(q_mid).  Loads and
damping enter (3) by the discrete principle of d'Alembert.

Properties.  L_d has the symmetries of L: momentum and angular momentum are exact.  The map from
(q0, v0) to (q1, v1) is symplectic, so that in smooth motion the error of the energy is of second
order in h and oscillates without drift for exponentially long times, as long as h resolves the
fastest frequency (E. Hairer, C. Lubich & G. Wanner, Geometric Numerical Integration (2006),
sections VI.6 and IX.8).  Joints, whose measures are zero at the ends of each step, do no work:
De(q_mid)(q1 - q0) = e1 - e0 = 0.

Limits.  A step that does not resolve the stiffest motion gives energy without bound, as the
midpoint rule of nonlinear elasticity does; the strain e(q_mid) is shorter than the mean of both
ends by ⅛ D²e[q1 - q0, q1 - q0].

Source: J. E. Marsden & M. West, Acta Numerica 10 (2001) 357, doi:10.1017/S096249290100006X,
examples 2.3.1 and 2.6.1.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.lookups import check_no_contact, check_no_gas
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.strain_path import energy_gradient
from gossamer_fx.mechanics.materials.film import CLaw
from gossamer_fx.mechanics.terms.discrete_gradient import PathEnergy, StressRule
from gossamer_fx.solve.solvers.convergence import Tolerances
from gossamer_fx.solve.steppers.midpoint import MidpointSolver
from gossamer_fx.solve.steppers.stepping import Stepper, check_step
from gossamer_fx.solve.system.system import System


@dataclass(frozen=True)
class StressInMiddle(StressRule):
    """Stress rule of `VariationalMidpoint`: the stress of the strain in the middle of the step."""

    alpha = 0.5
    takes_mid_strain = True

    def stress(self, energy: PathEnergy, e0: Expr, e1: Expr) -> Expr:
        # By `takes_mid_strain`, e1 is the strain in the middle of the step.
        return energy_gradient(energy.density, e1)

    def function_of(self, law: CLaw) -> int:
        # The C function of the stress of one strain.
        return law.end_point


@check_arguments
@dataclass(frozen=True)
class VariationalMidpoint(Stepper):
    """Variational integrator: discrete Euler-Lagrange equations with midpoint quadrature.

    Second order in `dt`, symplectic, and with exact momentum and angular momentum.  The energy is
    not exact: in smooth motion that the step resolves, its error is of second order in `dt` and
    oscillates without drift; in steps that are too long for a stiff film it grows.  `Midpoint`
    conserves the energy for every step.

    (J. E. Marsden & M. West, Acta Numerica 10 (2001) 357, doi:10.1017/S096249290100006X.)

    Args:
        dt: step [s].
        tolerances: when a step counts as solved.

    Raises:
        InputError: dt is not a positive number; at the start of a run: the scene has contact or
            gas, a rope that is paid out, a reduced film or an orbit.

    Example:
        >>> run = gx.Simulation(gx.Scene(hub), gx.steppers.VariationalMidpoint(dt=0.1))
        >>> run.run(until=1.0)
        >>> run.step
        10
    """

    dt: float
    _: KW_ONLY
    tolerances: Tolerances = field(default_factory=Tolerances)

    # The stress in the middle of a step acts in it.
    rule = StressInMiddle()

    def __post_init__(self) -> None:
        check_step(self)

    def start(self, system: System) -> MidpointSolver:
        """The rule at work on a compiled system, which has no contact and no gas."""
        # Both have forces of a separate rule, which conserves energy: the steps would have no
        # discrete Lagrangian.
        check_no_contact(
            system, "VariationalMidpoint", "whose forces follow from both ends of a step"
        )
        check_no_gas(
            system, "VariationalMidpoint", "whose pressure follows from both ends of a step"
        )
        return MidpointSolver(system, self.tolerances)
