"""Pure bending of an inflated tube, up to the first wrinkle and beyond (Stein & Hedgepeth, NASA TN
D-813, 1961).

A tube of inflated radius r and wall t under the pressure p, whose ends bear P = p π r²; small
strains, hoop stress pr/t.  Beyond the curvature κ_w = p/(2Et) it wrinkles over the angle 2 θ0 on
the compression side:

    κ ≤ κ_w    M = E π r³ t κ                                  first wrinkle at M_w = p π r³/2
    κ ≥ κ_w    sin θ0 + (π - θ0) cos θ0 = π κ_w/κ,    M = E t κ r³ (π - θ0 + ½ sin 2θ0)    →  p π r³

The ends stay plane and get the displacement of that solution, ε = κ (z + r cos θ0) - ν p r/(Et);
the moment is the reaction of one of them.  M_w is found by bisection: the smallest moment at which
a cell wrinkles.
"""

from __future__ import annotations

import math

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq

import gossamer_fx as gx
from demos.common.searches import Effort
from demos.studies.engine.study import Measure, Study
from gossamer_fx.extend import AreaFractions, Array
from gossamer_fx.meshes.tube_section import cylinder

# Sizes [m] and modulus [Pa] of half of the tube.
RADIUS = 1.0
LENGTH = 1.0
E = 1e9
NU = 0.3
THICKNESS = 1e-3
LAW = gx.Miyazaki(E=E, nu=NU, density=1000.0, thickness=THICKNESS, residual_stiffness=1e-6)
P = 2e-4 * E * THICKNESS / RADIUS
INFLATED = RADIUS * (1 + (1 - NU / 2) * P * RADIUS / (E * THICKNESS))
# Curvature κ_w [1/m] of the first wrinkle, and its moment [N m].
FIRST = P / (2 * E * THICKNESS)
M_FIRST = P * math.pi * INFLATED**3 / 2
BENT = (2.0, 5.0)  # κ/κ_w at which the moment is compared
# Bisections of the curvature at which the first wrinkles appear, to a 256th of the interval.
BISECTIONS = 8


def wrinkled_angle(ratio: float) -> float:
    """θ0 [rad] for κ/κ_w ≥ 1."""
    if ratio == 1:
        return 0.0
    return float(
        brentq(lambda θ: math.sin(θ) + (math.pi - θ) * math.cos(θ) - math.pi / ratio, 0.0, math.pi)
    )


def moment(ratio: float) -> float:
    """M [N m] for κ/κ_w."""
    if ratio <= 1:
        return M_FIRST * ratio
    θ0 = wrinkled_angle(ratio)
    return E * THICKNESS * ratio * FIRST * INFLATED**3 * (math.pi - θ0 + math.sin(2 * θ0) / 2)


def turn(X: Array, ratio: float) -> Array:
    """Displacement of the last rim; the time of the continuation is κ/κ_w."""
    κ = ratio * FIRST
    # Up to the first wrinkle the mean strain is that of the pressure, R κ_w.
    curvature = FIRST
    if ratio > 1:
        curvature = κ * math.cos(wrinkled_angle(ratio))
    mean = INFLATED * curvature
    ε = κ * X[2] + mean - NU * P * RADIUS / (E * THICKNESS)
    return np.vstack([ε * X[0], 0 * ε, 0 * ε])


def problem(comm: MPI.Comm, element: str, sides: int) -> dict[str, float]:
    """From a plane of symmetry at x = 0 to the end that is turned, `sides` edges around."""
    order = {"P1": 1, "P2": 2}[element]
    film = gx.Membrane(
        cylinder(comm, RADIUS, LENGTH, sides, max(round(sides / 6), 2), order), LAW, order=order
    )
    middle = gx.Fixed(film, "first rim", components=(0,))
    end = gx.Fixed(film, "last rim", motion=turn, components=(0,))
    held = [gx.Fixed(film, line, components=(1,)) for line in ("top", "bottom")]
    held += [gx.Fixed(film, point, components=(2,)) for point in ("first left", "first right")]
    search = gx.Equilibrium(gx.Scene(film, gx.Pressure(film, P), middle, end, *held))
    fractions = AreaFractions([film])
    effort = Effort()

    def bend(ratio: float) -> tuple[float, float]:
        """(M, wrinkled and slack part of the area)."""
        effort.add(search.find(at=ratio))
        slack, wrinkled, _ = fractions(search.system)
        return abs(float(search.reaction(middle)[1][1])), slack + wrinkled

    results = {"M(½κ_w)/exact": bend(0.5)[0] / moment(0.5)}
    # κ/κ_w without and with wrinkles, and the moment at the smallest one with them.
    taut = 0.8
    buckled = 1.3
    M_w = math.nan
    for _ in range(BISECTIONS):
        ratio = (taut + buckled) / 2
        M, share = bend(ratio)
        if share > 0:
            buckled = ratio
            M_w = M
        else:
            taut = ratio
    results["M_w/exact"] = M_w / M_FIRST
    for ratio in BENT:
        M, share = bend(ratio)
        results[f"M({ratio:g}κ_w)/exact"] = M / moment(ratio)
        results[f"θ0({ratio:g}κ_w)/exact"] = share * math.pi / wrinkled_angle(ratio)
    return results | {
        **vars(effort),
        "compile_seconds": search.compile_seconds,
    }


STUDY = Study(
    "bent_tube",
    "Bending of an inflated tube",
    problem,
    {"element": ["P1", "P2"], "sides": [16, 32, 64]},
    lambda case: 2 * math.pi * RADIUS / case["sides"],
    (
        Measure("M_w/exact", 1.0, 3e-2),
        *(Measure(f"M({ratio:g}κ_w)/exact", 1.0, 1e-2) for ratio in BENT),
    ),
    quick={"sides": [16, 32]},
    columns=(
        "M(½κ_w)/exact, "
        + "".join(f"θ0({ratio:g}κ_w)/exact, " for ratio in BENT)
        + "iterations, residual, seconds"
    ),
)
