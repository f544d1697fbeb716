"""Cords that unload on another curve than they are loaded: hysteresis of a tabulated law.

Problem.  A braided cord that was pulled to a force gives it back on a steeper curve, and the area
between both curves is lost.  Tables of both are measured.  A step may pass the strain at which the
cord changes from one curve to the other, and has to conserve energy but for the loss.

Idea.  The history of a cord is one number, the largest strain X so far.  Beyond X the force is that
of the loading curve, N_l(x).  Up to X it is the upper part of the unloading curve v(y), moved in
both axes so that its end (y_m, v_m) is at the turning point (X, N_l(X)), and cut at zero force:

    N_u(x; X) = ⟨v(y_m + x - X) - v_m + N_l(X)⟩,    ⟨y⟩ = max(y, 0).                             (1)

Reloading follows (1) back to the turning point, then the loading curve.  Turning points beyond v_m
take the continuation of v with its last slope.  With W the integral of N_u from where the cord is
slack, what is lost by loading to X is

    D(X) = ∫₀^X N_l dx - W(X; X),                                                                (2)

so that the work of loading from X to x is the change of W(x; x) + D(x).  The loss of a cycle, the
area between both curves, counts as dissipated while the strain grows beyond X.  The mean force of a
step is the exact average over the piecewise linear path, divided at X where the step passes it.

Condition.  D must not fall: D' = N_l - δ N_l' >= 0, with δ(X) the strain in which (1) gets slack.

Sources.  That a reversal is followed by one curve from the turning point is Masing's assumption (G.
Masing, Proc. 2nd Int. Congr. Appl. Mech., Zürich 1926, 332), here with a measured curve in place of
the doubled loading curve.  The torus models of the University of Maine scale the unloading curve in
both axes to the turning point instead (github.com/BradenMorrow/HIAD_FEA, 2022).

Limits.  Cycles below the largest strain dissipate nothing.  A slack cord is longer by X - δ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.laws.tracing import Number, at_most
from gossamer_fx.mechanics.bodies.piecewise_force import Corners, corners_in, stretch_of
from gossamer_fx.mechanics.terms.rows import Response, positive_part

# A fall of D over the force that counts as round-off, as where both curves are one straight line.
ROUND_OFF = 1e-12

# Rise of a flat part of an unloading curve over its largest force
FLAT = 1e-12


@dataclass(frozen=True, eq=False)
class Hysteresis:
    """Forces of cords by equations (1) and (2) of the module.

    Strains in the methods are numbers, symbols of a law, or arrays.

    Attributes:
        tension, compression: corners of the loading curve N_l on both sides.
        unloading: corners of the unloading curve v in tension.
        slack: corners of the strain of v as a function of its force, from that of its first corner.
        end: strain y_m of the last point of the unloading curve.
    """

    tension: Corners
    compression: Corners
    unloading: Corners
    slack: Corners
    end: Number

    def branch(self, X: Any) -> Corners:
        """N_u(x; X) of the turning point X."""
        v = self.unloading
        turning_force = self.tension.force(X)
        end_force = v.force(self.end)
        # The strain of v, continued with its last slope, that is moved to the turning point.
        top = self.end + positive_part(turning_force - end_force) / sum(v.slope_changes)
        # Corners below the force at which the branch is cut move to where it is cut: their slopes
        # add up to the slope there.
        slack = v.strains[0] + self.slack.force(positive_part(end_force - turning_force))
        strains = []
        for y in v.strains:
            strains.append(_larger(y, slack) + X - top)
        return Corners(strains, v.sides, v.slope_changes)

    def check_losses(self, last: float) -> None:
        """Raise `InputError` if there is a strain, up to the last one of the loading curve, up to
        which a cycle would gain energy."""
        tension = self.tension
        points = np.append(tension.strains, last)
        # D' is linear between corners of N_l and of δ.  δ has a corner where (1) is cut at a corner
        # of v, as the turning force is v_m less the force there.
        v = self.unloading
        turning_forces = v.force(self.end) - v.force(np.asarray(v.strains))
        X = np.unique([*points, *np.interp(turning_forces, tension.force(points), points)])
        force = tension.force(X)
        slope = np.diff(force) / np.diff(X)
        δ = X - self.branch(X).strains[0]
        # D' at the beginnings of the intervals, then at their ends.
        for end in (slice(None, -1), slice(1, None)):
            growth = force[end] - δ[end] * slope
            gains = growth < -ROUND_OFF * np.maximum(force[end], slope)
            check(
                not gains.any(),
                f"TabulatedCable: a cycle up to the strain {X[end][gains.argmax()]:.4g} gains "
                "energy, as the unloading curve is not steep enough; give a steeper one.",
            )

    def energy(self, x: Any, X: Any) -> Any:
        """W [J/m] of strains x up to the largest ones X, in tension and compression."""
        return self.compression.energy(x) + self.branch(X).energy(x)

    def dissipated(self, X: Any) -> Any:
        """D(X) [J/m]."""
        return self.tension.energy(X) - self.branch(X).energy(X)

    def average(self, x0: Any, x1: Any, X: Any) -> Any:
        """Force [N] averaged over the path from x0 to x1, if the largest strain before is X.  Only
        x1, or both if they are equal, may be beyond X."""
        below = self.branch(X).average(_smaller(x0, X), _smaller(x1, X))
        above = self.tension.average(_larger(x0, X), _larger(x1, X))
        # The share of the path on the loading curve.
        is_beyond = at_most(x1, X, holds=0.0, fails=1.0)
        passes = at_most(X, x0, holds=0.0, fails=is_beyond)
        change = at_most(passes, 0.5, holds=1.0, fails=x1 - x0)
        share = at_most(passes, 0.5, holds=is_beyond, fails=(x1 - X) / change)
        return self.compression.average(x0, x1) + (1 - share) * below + share * above

    def as_numbers(self) -> dict[str, Any]:
        """Numbers of `Rows`, from which `hysteretic_bar` makes it."""
        numbers = {"end": self.end}
        for name in CURVES:
            numbers |= getattr(self, name).as_numbers(f"{name}_")
        return numbers


# Attributes of `Hysteresis` that are corners
CURVES = ("tension", "compression", "unloading", "slack")


def _larger(x: Any, y: Any) -> Any:
    return at_most(x, y, holds=y, fails=x)


def _smaller(x: Any, y: Any) -> Any:
    return at_most(x, y, holds=x, fails=y)


def hysteresis_of(loading: Corners, unloading: Corners, end: float) -> Hysteresis:
    """The hysteresis of two curves; `end`: last strain of the unloading curve."""
    points = np.append(unloading.strains, end)
    forces = unloading.force(points)
    # A flat part of the curve is taken as one of hardly any slope.
    rises = np.maximum(np.diff(forces), FLAT * forces[-1])
    slack = Corners(
        strains=forces[:-1],
        sides=np.ones(len(rises)),
        slope_changes=np.diff(np.diff(points) / rises, prepend=0.0),
    )
    return Hysteresis(loading.of_side(1), loading.of_side(-1), unloading, slack, end)


def hysteretic_bar(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """Energy and loss of a bar with hysteresis, as a function of ε = ½(λ² - 1); its history is the
    largest strain X so far."""
    corners = {name: corners_in(numbers, f"{name}_") for name in CURVES}
    curves = Hysteresis(**corners, end=numbers.end)
    λ0 = stretch_of(e0[0])
    λ1 = stretch_of(e1[0])
    [X] = z0
    # A strain that was just reached is one from which the cord unloads.
    before = _larger(λ0 - 1, X)
    after = _larger(λ1 - 1, X)
    L = numbers.length
    return Response(
        [L * curves.average(λ0 - 1, λ1 - 1, X) / ((λ0 + λ1) / 2)],
        energy=L * curves.energy(λ1 - 1, after),
        loss=L * (curves.dissipated(after) - curves.dissipated(before)),
        history=[after],
    )
