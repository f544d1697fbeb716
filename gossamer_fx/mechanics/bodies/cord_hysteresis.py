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

Another rule.  By (1) a cord is as steep after each reversal as at the end of v.  `ScaledHysteresis`
scales the whole curve, from the origin, in both axes to the turning point instead,

    N_u(x; X) = N_l(X)/v_m v(y_m x/X),                                                          (3)

so that the slope at a reversal depends on the force there, and the part X y_0/y_m of the strain is
not recovered, y_0 being the strain at which v is slack.

Condition.  D must not fall: D' = N_l - δ N_l' >= 0, with δ(X) the strain in which (1) gets slack.
By (3) D' = N_l - κ (N_l + X N_l'), with κ = ∫v dy/(v_m y_m).

Sources.  That a reversal is followed by one curve from the turning point is Masing's assumption (G.
Masing, Proc. 2nd Int. Congr. Appl. Mech., Zürich 1926, 332), here with a measured curve in place of
the doubled loading curve.  The torus models of the University of Maine scale the unloading curve in
both axes to the turning point, by (3) (github.com/BradenMorrow/HIAD_FEA, 2022).

Limits.  Cycles below the largest strain dissipate nothing.  A slack cord is longer by X - δ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.laws.tracing import Number, at_most
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.piecewise_force import Corners, corners_in, stretch_of
from gossamer_fx.mechanics.terms.rows import Response, positive_part

# A fall of D over the force that counts as round-off, as where both curves are one straight line.
ROUND_OFF = 1e-12

# Least turning point of (3), a strain of round-off
SMALLEST_TURN = 1e-12

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
        X = self._corners_of_loss(last)
        force = self.tension.force(X)
        slope = np.diff(force) / np.diff(X)
        # D' at the beginnings of the intervals, then at their ends.
        for end in (slice(None, -1), slice(1, None)):
            growth = self._loss_growth(X[end], force[end], slope)
            gains = growth < -ROUND_OFF * np.maximum(force[end], slope)
            check(
                not gains.any(),
                f"TabulatedCable: a cycle up to the strain {X[end][gains.argmax()]:.4g} gains "
                "energy, as the unloading curve is not steep enough; give a steeper one.",
            )

    def _corners_of_loss(self, last: float) -> Array:
        """Strains (n,) between which D' is linear, up to the last one."""
        tension = self.tension
        points = np.append(tension.strains, last)
        # D' is linear between corners of N_l and of δ.  δ has a corner where (1) is cut at a corner
        # of v, as the turning force is v_m less the force there.
        v = self.unloading
        turning_forces = v.force(self.end) - v.force(np.asarray(v.strains))
        return np.unique([*points, *np.interp(turning_forces, tension.force(points), points)])

    def _loss_growth(self, X: Array, force: Array, slope: Array) -> Array:
        """D' [N] at strains (n,) with the force and the slope of the loading curve."""
        return force - (X - self.branch(X).strains[0]) * slope

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


@dataclass(frozen=True, eq=False)
class ScaledHysteresis(Hysteresis):
    """Forces of cords by equations (3) and (2) of the module.

    Attributes:
        start: strain y_0 at which the unloading curve v is slack; corners of v and its end are
            counted from it.
    """

    start: Number

    def branch(self, X: Any) -> Corners:
        """N_u(x; X) of the turning point X."""
        v = self.unloading
        # At the start no strain was reached yet: the limit of the slopes.
        X = _larger(X, SMALLEST_TURN)
        full = self.start + self.end
        slope_ratio = self.tension.force(X) / v.force(self.end) * full / X
        strains = []
        changes = []
        for y, change in zip(v.strains, v.slope_changes, strict=True):
            strains.append((self.start + y) * X / full)
            changes.append(change * slope_ratio)
        return Corners(strains, v.sides, changes)

    def _corners_of_loss(self, last: float) -> Array:
        return np.append(self.tension.strains, last)

    def _loss_growth(self, X: Array, force: Array, slope: Array) -> Array:
        v = self.unloading
        share = v.energy(self.end) / (v.force(self.end) * (self.start + self.end))
        return force - share * (force + X * slope)

    def as_numbers(self) -> dict[str, Any]:
        return super().as_numbers() | {"start": self.start}


# Attributes of `Hysteresis` that are corners
CURVES = ("tension", "compression", "unloading", "slack")


def _larger(x: Any, y: Any) -> Any:
    return at_most(x, y, holds=y, fails=x)


def _smaller(x: Any, y: Any) -> Any:
    return at_most(x, y, holds=x, fails=y)


def hysteresis_of(loading: Corners, unloading: Corners, end: float) -> Hysteresis:
    """The hysteresis of two curves by (1); `end`: last strain of the unloading curve."""
    return Hysteresis(**_curves_of(loading, unloading, end), end=end)


def scaled_hysteresis_of(
    loading: Corners, unloading: Corners, end: float, start: float
) -> ScaledHysteresis:
    """The hysteresis of two curves by (3); `end`: last strain of the unloading curve, which is
    counted from the strain `start` at which it is slack."""
    return ScaledHysteresis(**_curves_of(loading, unloading, end), end=end, start=start)


def _curves_of(loading: Corners, unloading: Corners, end: float) -> dict[str, Corners]:
    """The curves of `CURVES`."""
    points = np.append(unloading.strains, end)
    forces = unloading.force(points)
    # A flat part of the curve is taken as one of hardly any slope.
    rises = np.maximum(np.diff(forces), FLAT * forces[-1])
    slack = Corners(
        strains=forces[:-1],
        sides=np.ones(len(rises)),
        slope_changes=np.diff(np.diff(points) / rises, prepend=0.0),
    )
    return {
        "tension": loading.of_side(1),
        "compression": loading.of_side(-1),
        "unloading": unloading,
        "slack": slack,
    }


def hysteretic_bar(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """Energy and loss of a bar with the hysteresis (1), as a function of ε = ½(λ² - 1); its history
    is the largest strain X so far."""
    return _response(Hysteresis(**_curves_in(numbers), end=numbers.end), e0, e1, z0, numbers)


def scaled_hysteretic_bar(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """The same with the hysteresis (3)."""
    curves = ScaledHysteresis(**_curves_in(numbers), end=numbers.end, start=numbers.start)
    return _response(curves, e0, e1, z0, numbers)


def _curves_in(numbers: Any) -> dict[str, Corners]:
    """The curves among the numbers of a law."""
    return {name: corners_in(numbers, f"{name}_") for name in CURVES}


def _response(curves: Hysteresis, e0: Any, e1: Any, z0: Any, numbers: Any) -> Response:
    """What a bar does in a step."""
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
