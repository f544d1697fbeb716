"""A closed tube under pressure: stretches of the wall away from the caps.

StVK cylinder of radius r0 and wall t under the follower pressure p, q = p r0/(Et).  Its flat caps
bulge and wrinkle; the wall away from them has

    2 S_x λ_x = (p r0/t) λ_t²,   S_t = (p r0/t) λ_x,   E (λ_x² - 1)/2 = S_x - ν S_t,   E (λ_t² -
                                 1)/2 = S_t - ν S_x.

The film starts unstressed and whole: nothing holds it, the equilibrium is unique but for rigid
motions.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.engine.study import Measure, Study, search_figures
from gossamer_fx.extend import Array
from gossamer_fx.meshes.tube_section import capped_cylinder

# Of the wall without pressure [m].
RADIUS = 1.0
LENGTH = 4.0
FILM = {"E": 1e9, "nu": 0.3, "density": 1000.0, "thickness": 1e-3}
LAW = gx.Miyazaki(**FILM, residual_stiffness=1e-6)


@cache
def exact(q: float) -> tuple[float, float]:
    """(λ_x, λ_t), by a fixed-point iteration that contracts with the rate q."""
    ν = FILM["nu"]
    λ_x = 1.0
    λ_t = 1.0
    # The rate is below a tenth: a hundred iterations reach round-off.
    for _ in range(100):
        S_x = q * λ_t**2 / (2 * λ_x)
        S_t = q * λ_x
        λ_x = math.sqrt(1 + 2 * (S_x - ν * S_t))
        λ_t = math.sqrt(1 + 2 * (S_t - ν * S_x))
    return λ_x, λ_t


def stretches(film: gx.Membrane, search: gx.Equilibrium) -> tuple[float, float]:
    """(λ_x, λ_t) of the middle quarter of the wall: mean distance from its axis, and slope of x
    over X."""
    x = search.system.unknowns.q0.array_r.reshape(-1, 3)
    X = film.space.tabulate_dof_coordinates()[: len(x)]
    # Away from the caps, which disturb the wall over a few radii.
    middle = abs(X[:, 0] / LENGTH - 0.5) < 0.125

    def sums(values: Array) -> Array:
        return film.comm.allreduce(values.sum(axis=0))

    n = float(sums(np.ones(middle.sum())))
    # About the mean of the middle part, as nothing holds the tube.
    x = x[middle] - sums(x[middle]) / n
    X = X[middle] - sums(X[middle]) / n
    λ_x = sums(x[:, 0] * X[:, 0]) / sums(X[:, 0] ** 2)
    λ_t = sums(np.hypot(x[:, 1], x[:, 2])) / (n * RADIUS)
    return float(λ_x), float(λ_t)


def problem(comm: MPI.Comm, element: str, q: float, sides: int) -> dict[str, float]:
    """The whole tube with `sides` edges around."""
    order = {"P1": 1, "P2": 2}[element]
    along = 2 * round(sides * LENGTH / (12 * RADIUS))
    film = gx.Membrane(
        capped_cylinder(
            comm,
            RADIUS,
            LENGTH,
            sides,
            along,
            order,
        ),
        LAW,
        order=order,
    )
    search = gx.Equilibrium(
        gx.Scene(film, gx.Pressure(film, q * FILM["E"] * FILM["thickness"] / RADIUS))
    )
    found = search.find()
    λ_x, λ_t = stretches(film, search)
    return {
        "λ_x": λ_x,
        "λ_t": λ_t,
        **search_figures(found),
        "compile_seconds": search.compile_seconds,
    }


STUDY = Study(
    "inflated_tube",
    "Closed tube under pressure",
    problem,
    {"element": ["P1", "P2"], "q": [1e-2, 5e-2], "sides": [12, 24, 48]},
    lambda case: 2 * math.pi * RADIUS / case["sides"],
    (
        Measure(
            "λ_x",
            lambda case: exact(case["q"])[0],
            1e-3,
            lambda case: 2.0 if case["element"] == "P1" else math.inf,
        ),
        Measure("λ_t", lambda case: exact(case["q"])[1], 1e-3, lambda case: 2.0),
    ),
    expected_warnings={
        "nothing resists translation x, translation y": "the tube floats; stretches count"
    },
    quick={"q": [5e-2], "sides": [12, 24]},
    columns="iterations, residual, seconds",
)
