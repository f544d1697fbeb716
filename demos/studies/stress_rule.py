"""Which stress makes a film that wrinkles easy to move: rules of averaging on the spinning sheet.

All of these conserve momentum and angular momentum, and all but the last conserve the energy.  S(e)
= ψ'(e), Δe = e1 - e0, and [·] the correction along Δe that makes S_mean·Δe = ψ(e1) - ψ(e0) exact:

    Gonzalez        S_mean = ψ'((e0 + e1)/2) + [·]            (J. Nonlinear Sci. 6 (1996) 449)
    points n        S_mean = n Gauss points of ∫₀¹ ψ'(e0 + s Δe) ds + [·]
    exact           the integral itself, piece by piece between the points where the state switches
    variational     S_mean = ψ'(e(q_mid)), the variational integrator, which conserves momenta only

Measured are Newton iterations a step, rejected steps, and the drift of energy and angular momentum;
nan where a run fails.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from mpi4py import MPI

import gossamer_fx as gx
from demos.films.spinning_sheet import main
from demos.studies.engine.study import Claim, Study
from gossamer_fx.extend import (
    Expr,
    StoredEnergy,
    StressRule,
    energy_correction,
    energy_gradient,
)

# Steps of each run: enough that all cells switch their state.
STEPS = 40


@dataclass(frozen=True)
class Gonzalez(StressRule):
    """Stress at the mean strain, corrected along Δe."""

    alpha = 0.5
    conserves = True

    def stress(self, part: StoredEnergy, e0: Expr, e1: Expr) -> Expr:
        # The correction makes S·Δe the change of the energy.
        S = energy_gradient(part.density, (e0 + e1) / 2)
        return S + energy_correction(part.density, S, e0, e1)


@dataclass(frozen=True)
class GaussPoints(StressRule):
    """Stress averaged with `points` Gauss points on the whole path, wherever the state switches."""

    points: int
    alpha = 0.5
    conserves = True

    def stress(self, part: StoredEnergy, e0: Expr, e1: Expr) -> Expr:
        # Without pieces the law is integrated by points on the whole path.
        return gx.steppers.PathAverage(self.points).stress(replace(part, pieces=None), e0, e1)


# From few points to the exact integral; Gonzalez is one point.
RULES: dict[str, StressRule] = {
    "points 6": GaussPoints(6),
    "points 10": GaussPoints(10),
    "points 16": GaussPoints(16),
    "exact": gx.steppers.PathAverage(),
    "Gonzalez": Gonzalez(),
    "variational": gx.steppers.VariationalMidpoint(dt=1.0).rule,
}
COLUMNS = "newton_per_step, substeps, energy_drift, angular_momentum_drift, seconds"


def problem(comm: MPI.Comm, rule: str, h: float) -> dict[str, float]:
    """40 steps of the demo's sheet of 20 × 20 × 2 triangles."""
    stepper = gx.Midpoint(dt=h, rule=RULES[rule])
    try:
        return main(n=20, dt=h, steps=STEPS, stepper=stepper, comm=comm)
    except gx.StepFailure:
        return dict.fromkeys(COLUMNS.split(", "), math.nan)


STUDY = Study(
    "stress_rule",
    "Rules for the stress of a step, on the spinning sheet",
    problem,
    {"rule": list(RULES), "h": [1e-4, 1e-3, 4e-3]},
    lambda case: case["h"],
    quick={"rule": ["Gonzalez", "exact"], "h": [1e-3]},
    shows=("newton_per_step", "substeps"),
    claims=(
        # Of the table of docs/theory/step.md: the exact average needs no more than twice the
        # iterations of a small step, Gonzalez' gradient a multiple of them.
        Claim("newton_per_step", 3.3, 4.1, {"rule": "exact", "h": 1e-4}),
        Claim("newton_per_step", 6.0, 7.4, {"rule": "exact", "h": 1e-3}),
        Claim("newton_per_step", 8.1, 9.9, {"rule": "exact", "h": 4e-3}),
        Claim("newton_per_step", 37.0, 46.0, {"rule": "Gonzalez", "h": 1e-3}),
        Claim("substeps", 0, 0, {"rule": "exact"}),
        Claim("substeps", 37, 45, {"rule": "Gonzalez", "h": 1e-3}),
        Claim("energy_drift", 0.0, 1e-12, {"rule": "exact"}),
        Claim("energy_drift", 0.0, 1e-12, {"rule": "Gonzalez"}),
        Claim("energy_drift", 3.5e-7, 4.2e-7, {"rule": "variational", "h": 1e-4}),
        Claim("angular_momentum_drift", 0.0, 1e-13, {"rule": "exact"}),
        Claim("angular_momentum_drift", 0.0, 1e-13, {"rule": "Gonzalez"}),
    ),
    not_repeatable=dict.fromkeys(
        ("energy_drift", "energy_error", "angular_momentum_drift"), "round-off"
    ),
    columns=COLUMNS,
)
