"""Which stress makes a film that wrinkles easy to move: rules of averaging on the spinning sheet.

All of these conserve energy, momentum and angular momentum.  S(e) = ψ'(e), Δe = e1 - e0, and [·] the correction
along Δe that makes S̄·Δe = ψ(e1) - ψ(e0) exact:

    Gonzalez        S̄ = ψ'((e0 + e1)/2) + [·]            (J. Nonlinear Sci. 6 (1996) 449)
    path n          S̄ = Gauss points of ∫₀¹ ψ'(e0 + s Δe) ds + [·]
    split n         the same with n points on each piece between the places where the state switches

Measured are Newton iterations a step, steps that had to be halved, and the drift of energy and angular momentum.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

import gossamer_fx as gx
from demos.spinning_sheet import main
from gossamer_fx.discrete_gradient import StressRule, defect, gradient
from gossamer_fx.kinematics import Expr
from gossamer_fx.parts import Stored
from gossamer_fx.study import Study

STEPS = 40
NU, RESIDUAL = 0.3, 1e-6  # of the film of the demo: they decide where its state switches


@dataclass(frozen=True)
class Gonzalez:
    """Stress at the mean strain, corrected along Δe."""

    alpha = 0.5

    def stress(self, part: Stored, e0: Expr, e1: Expr) -> Expr:
        S = gradient(part.density, (e0 + e1) / 2)
        return S + defect(part.density, S, e0, e1)


@dataclass(frozen=True)
class SplitPath:
    """Stress averaged with `points` Gauss points on each piece of the path between its switching points."""

    points: int
    alpha = 0.5

    def stress(self, part: Stored, e0: Expr, e1: Expr) -> Expr:
        ψ, Δe = part.density, e1 - e0
        places, weights = np.polynomial.legendre.leggauss(self.points)
        S: Any = 0
        for a, b in itertools.pairwise([0.0, *switching_points(e0, e1), 1.0]):
            for p, w in zip(places, weights, strict=True):
                S = S + (b - a) * float(w) / 2 * gradient(ψ, e0 + (a + (b - a) * float(1 + p) / 2) * Δe)
        return S + defect(ψ, S, e0, e1)


def switching_points(e0: Expr, e1: Expr) -> list[Expr]:
    """The s in [0, 1], in order, at which e0 + s Δe passes the cones h = m r, m = (1-ν)/(1+ν) and (1-uν)/(1+uν).

    With h and r centre and radius of Mohr's circle, h² - m² r² is quadratic in s; roots outside count as 0 or 1.
    """
    roots = []
    for k in (NU, RESIDUAL * NU):
        m2 = ((1 - k) / (1 + k)) ** 2

        def form(a: Expr, b: Expr, m2: float = m2) -> Expr:
            radius = (a[0] - a[1]) * (b[0] - b[1]) + a[2] * b[2]
            return ((a[0] + a[1]) * (b[0] + b[1]) - m2 * radius) / 4

        A, B, C = form(e1 - e0, e1 - e0), form(e0, e1 - e0), form(e0, e0)
        discriminant = B * B - A * C
        q = -(B + ufl.conditional(ufl.ge(B, 0), 1.0, -1.0) * ufl.sqrt(ufl.max_value(discriminant, 0)))
        for numerator, denominator in ((q, A), (C, q)):
            inside = ufl.And(ufl.gt(discriminant, 0), ufl.gt(abs(denominator), abs(numerator)))
            s = numerator / ufl.conditional(ufl.gt(abs(denominator), 0), denominator, 1.0)
            roots.append(ufl.conditional(inside, ufl.max_value(s, 0.0), 0.0))
    for i, j in ((0, 1), (2, 3), (0, 2), (1, 3), (1, 2)):
        roots[i], roots[j] = ufl.min_value(roots[i], roots[j]), ufl.max_value(roots[i], roots[j])
    return roots


RULES: dict[str, StressRule] = {
    "path 6": gx.PathAverage(6),
    "path 10": gx.PathAverage(10),
    "path 16": gx.PathAverage(16),
    "split 3": SplitPath(3),
    "split 5": SplitPath(5),
    "Gonzalez": Gonzalez(),
}


def problem(comm: MPI.Comm, rule: str, h: float) -> dict[str, float]:
    """40 steps of the demo's sheet of 20 × 20 × 2 triangles."""
    return main(n=20, dt=h, steps=STEPS, stepper=gx.Midpoint(dt=h, rule=RULES[rule]), comm=comm)


STUDY = Study(
    "stress_rule",
    "Rules for the stress of a step, on the spinning sheet",
    problem,
    {"rule": list(RULES), "h": [1e-4, 1e-3, 4e-3]},
    lambda case: case["h"],
    quick={"rule": ["Gonzalez", "path 10"], "h": [1e-3]},
    columns=("newton_per_step", "substeps", "energy_drift", "angular_momentum_drift", "seconds"),
)
