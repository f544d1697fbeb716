"""Stress rules: the stress of a time step, such that energy and momenta are conserved exactly.

Problem.  A time step from q0 to q1 needs one force for the whole step.  With the midpoint rule, the
force of the middle configuration, the work of the step differs from the change of the stored
energy; in stiff films the difference adds up until the motion explodes.

Idea.  Strains e(q) are quadratic in the coordinates, so that with q_mid = (1 - α) q0 + α q1 and α =
1/2

    De(q_mid)(q1 - q0) = e1 - e0,    e0 = e(q0), e1 = e(q1)                                      (1)

holds exactly.  A stress S_mean with

    S_mean·(e1 - e0) = ψ(e1) - ψ(e0)                                                             (2)

then makes the work of the step equal to the change of the energy ψ.  Strains do not change in rigid
motions, so that the force has no resultant and no moment: momentum and angular momentum are
conserved.

Algorithm.

1. The forces of a step are those of the residual

       ∫ S_mean·De(q_mid)[w] dx                                                                  (3)

2. `PathAverage` takes the stress averaged along the straight path in strain space,

       S_mean = ∫₀¹ ψ'(e0 + s (e1 - e0)) ds,                                                     (4)

   which satisfies (2) if the integral is exact.
3. Where the law names the pieces of the path between which its state switches
   (`forms.strain_path`), each piece is integrated in closed form.  Elsewhere Gauss points
   approximate (4).
4. What the quadrature misses of (2) is added along Δe = e1 - e0 (`energy_correction`, Gonzalez):

       S_mean + (ψ(e1) - ψ(e0) - S_mean·Δe)/|Δe|² Δe                                             (5)

5. UFL takes the derivative of S_mean by e1, correction included, for the tangent.

What a rule states (`StressRule`) is all that forces know of a step: the weight α, whether (2)
holds (`conserves`), whether the step is a search for rest (`is_static`), and whether the stress is
that of the strain e(q_mid) (`takes_mid_strain`).  `EndPoint` has α = 1 and S_mean = ψ'(e1), for
steppers to compare with; `AtRest` is the same rule for statics.

Why the integral has to be exact.  The average (4) of a convex ψ is the gradient of a convex
function of e1: its derivative is symmetric and positive semi-definite.  A film that switches
between taut, wrinkled and slack then does not make Newton's iteration cycle.  With Gauss points (5)
is so large that the derivative is indefinite; on fine meshes a slack film is so soft that the
iteration cycles.

Cost.  One evaluation of the stress of a piece for each piece of the path; a path that stays in one
state has a cheaper expression (`cases`).

Limits.  A law that is not convex has an indefinite tangent.  (1) holds for quadratic measures;
others need a discrete derivative in place of De(q_mid), as those of beams have
(`forms.kinematics.beam_strain_change`).

Measured on the free sheet of the demo `spinning_sheet` by `demos/studies/stress_rule.py`; its table
is in `docs/theory/step.md`.  Sources: the path average, A. Harten, P. D. Lax & B. van Leer, SIAM
Rev. 25 (1983) 35, doi:10.1137/1025002; the correction, O. Gonzalez, J. Nonlinear Sci. 6 (1996) 449,
doi:10.1007/BF02440162; conservation by quadratic strains, J. C. Simo & N. Tarnow, Z. angew. Math.
Phys. 43 (1992) 757, doi:10.1007/BF00913408.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Protocol

import numpy as np
import ufl

from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.checks.errors import InputError
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.strain_path import Piece, energy_gradient
from gossamer_fx.mechanics.materials.film import CLaw

# Round-off of a difference of energies, over their sum.
ROUND_OFF = 4 * np.finfo(float).eps

# Length of a path in strain space below which energies do not correct its stress.  Film counts as
# taut to a compression of 1e-12, where its energy jumps.  Corrected for that, the stresses of film
# that hardly moves were above those of its strains, and Newton's iteration did not end.
SHORTEST_PATH = 3e-12


class PathEnergy(Protocol):
    """What a stress rule knows of a stored energy: its density ψ, whether that is quadratic, the
    pieces of a path on which it is smooth, and the C functions of a law that has them."""

    @property
    def density(self) -> Callable[[Expr], Expr]: ...

    @property
    def quadratic(self) -> bool: ...

    @property
    def pieces(self) -> Callable[[Expr, Expr], list[Piece]] | None: ...

    @property
    def c_law(self) -> CLaw | None: ...


def acts_at_end(alpha: float) -> bool:
    """Whether forces with the weight alpha of the end act in q1: the start has no weight."""
    return alpha == 1.0


class StressRule(ABC):
    """How the stress of a step follows from its strains.

    Attributes:
        alpha: weight α of the end in the configuration q_mid = (1 - α) q0 + α q1 in which forces
            act, above 0 and at most 1.
        conserves: whether the work of the stress is the change of the energy, (2) of the module.
        is_static: whether a step searches for rest: there is no motion, no friction and no history.
        takes_mid_strain: whether `stress` gets e(q_mid), the strain of the configuration in which
            forces act, in place of e1.  Thermal strain has its mean there.
    """

    alpha: float
    conserves: bool = False
    is_static: bool = False
    takes_mid_strain: bool = False

    @property
    def acts_at_end(self) -> bool:
        """Whether forces act in the configuration q1."""
        return acts_at_end(self.alpha)

    @abstractmethod
    def stress(self, energy: PathEnergy, e0: Expr, e1: Expr) -> Expr:
        """S_mean (m,) of strains e0 and e1 (m,), an expression of e0 and the UFL variable e1."""

    def cases(self, energy: PathEnergy, e0: Expr, e1: Expr) -> list[tuple[Expr, Expr]]:
        """Conditions under which S_mean costs less, and S_mean under each of them; the first that
        holds counts."""
        return []

    def function_of(self, law: CLaw) -> int:
        """Address of the C function for the mean stress of a step, for a law that is written in C.

        Args:
            law: addresses of the law's C functions.

        Raises:
            InputError: this rule, by which stresses follow from strains, has no such function; it
                then works only with laws in UFL.
        """
        raise InputError(
            f"the stress rule {type(self).__name__} cannot be used with a law whose stress is "
            "written in C, as that of Orthotropic; give the stepper the rule PathAverage(), or the "
            "film another law."
        )


@check_arguments
@dataclass(frozen=True)
class PathAverage(StressRule):
    """Stress rule of `Midpoint`: the stress averaged along the straight path in strain space; see
    the module.

    Args:
        points: of Gauss quadrature, for laws that do not give the smooth pieces of the path.

    Example:
        >>> gx.steppers.PathAverage(points=4).points
        4
    """

    points: Annotated[int, Range(1)] = 10
    alpha = 0.5
    conserves = True

    def stress(self, energy: PathEnergy, e0: Expr, e1: Expr) -> Expr:
        """Mean stress S_mean of a step with S_mean·(e1 - e0) = ψ(e1) - ψ(e0), averaged over the
        strain path.

        Args:
            energy: stored energy: its density ψ as a function of the strain, whether it is
                quadratic, and the pieces of a strain path on which it is smooth, each with its mean
                stress.
            e0: strain (m,) at the start of the step, dimensionless.
            e1: strain (m,) at its end, a UFL variable, by which the result can be derived.

        Returns:
            UFL vector (m,), in the unit of ψ (per area [N/m], per length [N]).
        """
        # Δe (m,) is the change of strain in the step, S (m,) the sum that becomes the mean stress.
        ψ = energy.density
        Δe = e1 - e0
        # The average (4) of a linear stress is that in the middle: exact, without a correction.
        if energy.quadratic:
            return energy_gradient(ψ, (e0 + e1) / 2)
        S = ufl.zero(Δe.ufl_shape)
        # Step 3.  Where two pieces meet they have the same stress: the derivative of a point at
        # which the integral is divided cancels, and need not be taken.
        pieces = energy.pieces(e0, e1.expression()) if energy.pieces else []
        for piece in pieces:
            S += (piece.end - piece.start) * piece.stress(
                e0 + piece.start * Δe, e0 + piece.end * Δe
            )
        if not pieces:
            # Gauss points p and weights w are on [-1, 1] with weights that add up to 2; the path is
            # on [0, 1].
            for p, w in zip(*np.polynomial.legendre.leggauss(self.points), strict=True):
                S += float(w) / 2 * energy_gradient(ψ, e0 + float(1 + p) / 2 * Δe)
        return S + energy_correction(ψ, S, e0, e1)

    def function_of(self, law: CLaw) -> int:
        return law.path_average

    def cases(self, energy: PathEnergy, e0: Expr, e1: Expr) -> list[tuple[Expr, Expr]]:
        """Cheaper expressions of the mean stress, for paths on which the material stays in one
        state.

        They serve six of ten paths in the iterations of a film that flutters, seven before it does.

        Args:
            energy: stored energy: its density as a function of the strain, whether it is quadratic,
                and the pieces of a strain path (shares `start` to `end` of it, from 0 to 1) on
                which the material is in one state, each with its mean stress.
            e0: strain (m,) at the start of the step, dimensionless.
            e1: strain (m,) at its end, a UFL variable.

        Returns:
            Conditions, and mean stresses (m,) in the unit of the density (per area [N/m], per
            length [N]), all UFL expressions; the first condition that holds counts.  Empty where
            one expression serves all paths.
        """
        if energy.quadratic or not energy.pieces:
            return []
        pieces = energy.pieces(e0, e1.expression())
        if len(pieces) <= 1:
            # One expression serves every path.
            return []
        lengths: dict[Callable[[Expr, Expr], Expr], list[Expr]] = {}
        for piece in pieces:
            lengths.setdefault(piece.stress, []).append(piece.end - piece.start)
        found = []
        for stress, parts in lengths.items():
            # Pieces of one state that fill the path: the average needs no division of it.  S (m,)
            # is the mean stress of that state over the whole path.
            fills_path = ufl.ge(sum(parts[1:], parts[0]), 1.0)
            S = stress(e0, e1)
            found.append((fills_path, S + energy_correction(energy.density, S, e0, e1)))
        return found


@check_arguments
@dataclass(frozen=True)
class EndPoint(StressRule):
    """Stress rule of backward Euler: the stress at the end of the step.

    Example:
        >>> gx.steppers.EndPoint()
        EndPoint()
    """

    alpha = 1.0

    def stress(self, energy: PathEnergy, e0: Expr, e1: Expr) -> Expr:
        return energy_gradient(energy.density, e1)

    def function_of(self, law: CLaw) -> int:
        return law.end_point


class AtRest(EndPoint):
    """Stress rule of statics, whose steps are those of a search for equilibrium."""

    is_static = True


def gonzalez_correction(
    missing: Expr, changes: Sequence[Expr], smallest: float | Expr
) -> list[Expr]:
    """Coefficients c_i along measures g_i that give back the energy which an approximate force
    misses.

        c_i = missing Δg_i / Σ_j Δg_j²,    so that Σ_i c_i Δg_i = missing

    (O. Gonzalez, J. Nonlinear Sci. 6 (1996) 449, doi:10.1007/BF02440162.)  If the measures g_i do
    not change in rigid motions, the correction keeps both momenta.

    Args:
        missing: change of the energy (or its density), less the work of the approximate force, a
            UFL scalar.
        changes: Δg_i, the changes of the measures in the step, UFL scalars, e.g. of strains.
        smallest: lower bound of the sum of squares Σ_j Δg_j², in its unit; below it the step is too
            small for a correction to mean anything.

    Returns:
        UFL scalars, as many as there are changes, in the unit of `missing` over that of g_i.
    """
    squares = ufl.max_value(sum(change * change for change in changes), smallest)
    return [missing / squares * change for change in changes]


def energy_correction(
    ψ: Any,
    S: Expr,
    e0: Expr,
    e1: Expr,
) -> Expr:
    """Gonzalez correction of the mean stress of a step: ((Δψ - S·Δe)/|Δe|²) Δe with Δe = e1 - e0.

    With it the work of the stress is the change of the energy.  It is zero within the round-off of
    the energies, and for |Δe| below 1e-5 |e| or `SHORTEST_PATH`.  There it would only amplify
    noise.  A film that is taut over the whole step needs no correction, and the noise would stop
    its convergence.

    Args:
        ψ: energy density as a function of the strain (m,), e.g. per area [N/m].
        S: approximate mean stress, a UFL vector (m,) in the unit of ψ.
        e0, e1: strains (m,) at the start and the end of the step, dimensionless UFL vectors.

    Returns:
        UFL vector (m,), to be added to S.
    """
    Δe = e1 - e0
    smallest = ufl.max_value(1e-10 * (ufl.dot(e0, e0) + ufl.dot(e1, e1)), SHORTEST_PATH**2)
    # Energy densities at the start and the end of the step.
    ψ0 = ψ(e0)
    ψ1 = ψ(e1)
    missing = ψ1 - ψ0 - ufl.dot(S, Δe)
    # What is within round-off is cut off, not rounded: the correction stays continuous.
    noise = ROUND_OFF * (ψ0 + ψ1)
    missing -= ufl.max_value(ufl.min_value(missing, noise), -noise)
    components = [Δe[i] for i in range(Δe.ufl_shape[0])]
    correction = ufl.as_vector(gonzalez_correction(missing, components, smallest))
    is_large_enough = ufl.gt(ufl.dot(Δe, Δe), smallest)
    return ufl.conditional(is_large_enough, 1.0, 0.0) * correction
