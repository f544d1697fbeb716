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

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.mechanics.bodies.piecewise_force import Corners, TabulatedBars
from gossamer_fx.mechanics.terms.point_energies import PathDensity

# A fall of D over the force that counts as round-off, as where both curves are one straight line.
ROUND_OFF = 1e-12


@dataclass(frozen=True, eq=False)
class Hysteresis:
    """Forces of cords by equations (1) and (2) of the module, for arrays of strains.

    Attributes:
        loading: corners of the loading curve N_l, with those in compression.
        unloading: corners of the unloading curve v in tension.
        end: strain y_m of the last point of the unloading curve.
    """

    loading: Corners
    unloading: Corners
    end: float

    @cached_property
    def _tension(self) -> Corners:
        return _of_side(self.loading, 1)

    @cached_property
    def _compression(self) -> Corners:
        return _of_side(self.loading, -1)

    def branch(self, X: Array) -> Corners:
        """N_u(x; X) as corners (n, k), of the turning points X (n,)."""
        v = self.unloading
        turning_force = self._tension.force(X)
        end_force = float(v.force(np.array(self.end)))
        # The strain of v, continued with its last slope, that is moved to the turning point.
        top = self.end + np.maximum(turning_force - end_force, 0.0) / v.slope_changes.sum()
        # Corners below the force at which the branch is cut move to where it is cut: their slopes
        # add up to the slope there.
        slack = self._unloading_strain(np.maximum(end_force - turning_force, 0.0))
        strains = np.maximum(v.strains, slack[..., None]) + (X - top)[..., None]
        return replace(v, strains=strains)

    def _unloading_strain(self, force: Array) -> Array:
        """The strain at which v has a force up to that of its end."""
        points = np.append(self.unloading.strains, self.end)
        return np.interp(force, self.unloading.force(points), points)

    def check_losses(self, last: float) -> None:
        """Raise `InputError` if there is a strain, up to the last one of the loading curve, up to
        which a cycle would gain energy."""
        tension = self._tension
        points = np.append(tension.strains, last)
        # D' is linear between corners of N_l and of δ.  δ has a corner where (1) is cut at a corner
        # of v, as the turning force is v_m less the force there.
        v = self.unloading
        turning_forces = v.force(np.array(self.end)) - v.force(v.strains)
        X = np.unique([*points, *np.interp(turning_forces, tension.force(points), points)])
        force = tension.force(X)
        slope = np.diff(force) / np.diff(X)
        δ = X - self.branch(X).strains[:, 0]
        # D' at the beginnings of the intervals, then at their ends.
        for end in (slice(None, -1), slice(1, None)):
            growth = force[end] - δ[end] * slope
            gains = growth < -ROUND_OFF * np.maximum(force[end], slope)
            check(
                not gains.any(),
                f"TabulatedCable: a cycle up to the strain {X[end][gains.argmax()]:.4g} gains "
                "energy, as the unloading curve is not steep enough; give a steeper one.",
            )

    def energy(self, x: Array, X: Array) -> Array:
        """W [J/m] of strains x up to the largest ones X (n,), in tension and compression."""
        return self._compression.energy(x) + self.branch(X).energy(x)

    def dissipated(self, X: Array) -> Array:
        """D(X) [J/m]."""
        return self._tension.energy(X) - self.branch(X).energy(X)

    def average(self, x0: Array, x1: Array, X: Array) -> tuple[Array, Array]:
        """Force [N] averaged over the path from x0 to x1 (n,), and its derivative by x1, if the
        largest strain before is X.  Only x1, or both if they are equal, may be beyond X."""
        compression, compression_slope = self._compression.average(x0, x1)
        below, slope_below = self.branch(X).average(np.minimum(x0, X), np.minimum(x1, X))
        above, slope_above = self._tension.average(np.maximum(x0, X), np.maximum(x1, X))
        # The share of the path on the loading curve, and how it grows with x1.
        passes = (x0 < X) & (x1 > X)
        change = np.where(passes, x1 - x0, 1.0)
        share = np.where(passes, (x1 - X) / change, np.where(x1 > X, 1.0, 0.0))
        growth = np.where(passes, (1 - share) / change, 0.0)
        force = compression + (1 - share) * below + share * above
        slope = np.where(x1 > X, share * slope_above, slope_below)
        return force, compression_slope + slope + growth * (above - below)


def _of_side(corners: Corners, side: int) -> Corners:
    """The corners in tension (1) or in compression (-1)."""
    of_side = corners.sides == side
    return replace(
        corners,
        strains=corners.strains[of_side],
        sides=corners.sides[of_side],
        slope_changes=corners.slope_changes[of_side],
    )


@dataclass(frozen=True, eq=False)
class HystereticBars(TabulatedBars, PathDensity):
    """The energies of bars as of `TabulatedBars`, with hysteresis and its history.

    Attributes:
        law: force of the bars, in place of `corners`.
        numbers: positions (n,) of this rank's bars in the whole line.
        largest: X (n,), the largest strains so far; changed in place.
        comm: on whose ranks the bars are.
    """

    law: Hysteresis
    numbers: Indices
    largest: Array
    comm: MPI.Intracomm

    def energy(self, e: Array) -> Array:
        """Stored energies [J] (n,) of the strains ε (n, 1), which may be beyond `largest`."""
        x = self.strain(e)
        # A strain that was just reached is one from which the cord unloads.
        return self.lengths * self.law.energy(x, np.maximum(x, self.largest))

    def mean_force(self, x0: Array, x1: Array) -> tuple[Array, Array]:
        return self.law.average(x0, x1, self.largest)

    def take(self, e: Array) -> None:
        """Raise the largest strains to accepted ones, ε (n, 1)."""
        np.maximum(self.largest, self.strain(e), out=self.largest)

    def loss(self, e0: Array, e1: Array) -> Array:
        """Growth [J] (n,) of D, equation (2) of the module, from ε e0 to e1 (n, 1)."""
        before = np.maximum(self.strain(e0), self.largest)
        after = np.maximum(self.strain(e1), self.largest)
        return self.lengths * (self.law.dissipated(after) - self.law.dissipated(before))

    def get_history(self) -> dict[str, Any]:
        """The largest strain of each bar, in the order of the line.  Collective."""
        mine = [(int(k), float(X)) for k, X in zip(self.numbers, self.largest, strict=True)]
        of_all_ranks = sorted(bar for of_rank in self.comm.allgather(mine) for bar in of_rank)
        return {"largest strains": [largest for _, largest in of_all_ranks]}

    def shape_history(self) -> dict[str, Any]:
        return self.get_history()

    def set_history(self, state: dict[str, Any]) -> None:
        self.largest[:] = np.array(state["largest strains"])[self.numbers]
