"""Torsion of a rigid hub in a tensioned annular film: wrinkles spread from the hub.

A film between a hub of radius a and a rim of radius b, under the uniform tension σ0, whose hub is
turned by θ with the torque T; c = T/(2πt).  Of an axisymmetric plane film, for small strains,

    τ = c/r²,   (r σ_r)' = σ_t
    taut       σ_r = A + B/r²,  σ_t = A - B/r²,  u = r (σ_t - ν σ_r)/E
    wrinkled   σ_r σ_t = τ², so (r σ_r)² = k² - c²/r²;  principal strains ε1 = (σ_r + σ_t)/E and ε2
               at the angle tan φ = τ/σ_r to the radius:  u/r = ε1 sin²φ + ε2 cos²φ,  u' = ε1 cos²φ
               + ε2 sin²φ
    (v/r)' = γ/r,   γ = 2(1+ν)τ/E taut,  (ε1 - ε2) sin 2φ wrinkled

u and the stresses are continuous where A² = (B² + c²)/R⁴, and u/r = (1-ν)σ0/E at hub and rim.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from dolfinx import fem
from dolfinx.mesh import compute_midpoints
from mpi4py import MPI
from scipy.integrate import solve_ivp

import gossamer_fx as gx
from demos.studies.engine.study import Measure, Study, search_figures
from gossamer_fx.extend import FieldFunctions, FilmLaw
from gossamer_fx.meshes.disc import ring

# Radii and thickness [m], modulus [Pa].
HUB = 0.2
RIM = 1.0
THICKNESS = 2e-5
E = 2.3e9
NU = 0.3
# Tension σ0 [Pa], small enough for the theory of small strains, and the strain that it has in both
# directions.
TENSION = 1e-5 * E
STRAIN = (1 - NU) * TENSION / E
FILM = {"E": E, "nu": NU, "density": 1400.0, "thickness": THICKNESS}
LAWS: dict[str, FilmLaw] = {
    "Miyazaki 1e-6": gx.Miyazaki(**FILM, residual_stiffness=1e-6),
    "TensionField": gx.TensionField(**FILM),
}
# Radius [m] at which stresses are compared.
PROBE = 1.25 * HUB


@dataclass(frozen=True)
class Solution:
    """Rotation θ [rad] of the hub, radius R [m] of the wrinkles, and what the stresses are made
    of."""

    θ: float
    R: float
    A: float
    B: float
    c: float

    @property
    def k2(self) -> float:
        """k², from the radial stress at R."""
        return (self.R * self.A + self.B / self.R) ** 2 + (self.c / self.R) ** 2

    def stress(self, r: np.ndarray) -> np.ndarray:
        """Larger principal stress [Pa] at radii r (n,)."""
        σ_r = np.sqrt(np.maximum(self.k2 - (self.c / r) ** 2, 0.0)) / r
        wrinkled = σ_r + (self.c / r**2) ** 2 / np.maximum(σ_r, 1e-9 * self.A)
        return np.where(r < self.R, wrinkled, self.A + np.hypot(self.B, self.c) / r**2)


@cache
def exact(c: float) -> Solution:
    """For c = T/(2πt)."""
    from scipy.optimize import brentq

    if c <= TENSION * HUB**2:
        # Taut everywhere: pure torsion.
        rotation = c * (1 + NU) / E * (HUB**-2 - RIM**-2)
        return Solution(rotation, HUB, TENSION, 0.0, c)
    limit = TENSION * RIM**2

    def error_at_hub(B: float) -> float:
        """Relative error of the displacement of the hub, which is given."""
        displacement, _ = _inward(B, c)
        return displacement / (STRAIN * HUB) - 1

    B = brentq(
        error_at_hub,
        0.0,
        limit,
        xtol=1e-12 * limit,
    )
    _, solution = _inward(B, c)
    return solution


def _inward(B: float, c: float) -> tuple[float, Solution]:
    """u(a) and the solution, for the B of the taut part, integrated inward from R."""
    A = TENSION + (1 + NU) / (1 - NU) * B / RIM**2
    R = ((B**2 + c**2) / A**2) ** 0.25
    k2 = Solution(0.0, R, A, B, c).k2
    # No tension would be left at the hub: B is too small.
    if k2 <= (c / HUB) ** 2:
        return 2 * STRAIN * HUB, Solution(
            math.nan,
            R,
            A,
            B,
            c,
        )

    def rates(r: float, y: np.ndarray) -> np.ndarray:
        """(u', (v/r)') of y = (u, v/r)."""
        σ_r = math.sqrt(k2 - (c / r) ** 2) / r
        τ = c / r**2
        ε1 = (σ_r + τ**2 / σ_r) / E
        φ = math.atan2(τ, σ_r)
        sin2 = math.sin(φ) ** 2
        # From u/r; wrinkles make ε2 more compressive than the stress says.
        ε2 = (y[0] / r - ε1 * sin2) / (1 - sin2)
        radial = ε1 * (1 - sin2) + ε2 * sin2
        shear = (ε1 - ε2) * math.sin(2 * φ)
        return np.array([radial, shear / r])

    # Of the taut part, at its inner end.
    u = R / E * ((1 - NU) * A - (1 + NU) * B / R**2)
    rotation = -c * (1 + NU) / E * (R**-2 - RIM**-2)
    inward = solve_ivp(rates, (R, HUB), (u, rotation), rtol=1e-11, atol=1e-15)
    displacement, turn = inward.y[:, -1]
    return float(displacement), Solution(-float(turn), R, A, B, c)


def problem(
    comm: MPI.Comm,
    law: str,
    element: str,
    torque: float,
    nodes: int,
) -> dict[str, float]:
    """Turn the hub as the solution says for c = `torque` σ0 a², with `nodes` across the film."""
    order = {"P1": 1, "P2": 2}[element]
    cells = nodes // order
    c = torque * TENSION * HUB**2
    solution = exact(c)
    θ = solution.θ
    mesh = ring(
        comm,
        HUB,
        RIM,
        cells,
        4 * cells,
        order,
    )
    film = gx.Membrane(mesh, LAWS[law], order=order)

    def turn(X: np.ndarray, t: float) -> np.ndarray:
        """Displacement (3, n) of hub and rim: stretched by the tension, and the hub turned by
        -θ."""
        at_hub = np.hypot(X[0], X[1]) < (HUB + RIM) / 2
        angle = np.where(at_hub, -θ, 0.0)
        # Stretched by the tension first, then turned.
        x = (1 + STRAIN) * X[0]
        y = (1 + STRAIN) * X[1]
        turned_x = np.cos(angle) * x - np.sin(angle) * y
        turned_y = np.sin(angle) * x + np.cos(angle) * y
        return np.vstack([turned_x, turned_y, X[2]]) - X

    hub = gx.Fixed(
        film,
        "hub",
        motion=turn,
        components=(0, 1),
    )
    rim = gx.Fixed(
        film,
        "rim",
        motion=turn,
        components=(0, 1),
    )
    in_plane = gx.Fixed(film, "film", components=(2,))
    search = gx.Equilibrium(gx.Scene(film, hub, rim, in_plane))
    found = search.find()
    _, moment = search.reaction(hub)
    measured = abs(moment[2]) / (2 * math.pi * THICKNESS)
    # The angle is given and the torque measured: the error of the angle at a given torque follows
    # by the slope.
    slope = (exact(1.01 * c).θ - exact(0.99 * c).θ) / (0.02 * c)
    fields = FieldFunctions(search.system, film, ["second_piola_stress1"])
    fields.update()
    return {
        "θ/exact": θ / (θ + slope * (measured - c)),
        "T/exact": measured / c,
        "σ1/exact": mean_ratio(fields.functions[0], solution, (RIM - HUB) / cells),
        **search_figures(found),
        "compile_seconds": search.compile_seconds,
    }


def mean_ratio(stress: fem.Function, solution: Solution, width: float) -> float:
    """Mean of the computed over the exact stress, in the centres of the cells about the circle of
    the probe."""
    domain = stress.function_space.mesh
    cells = np.arange(domain.topology.index_map(2).size_local, dtype=np.int32)
    r = np.linalg.norm(compute_midpoints(domain, 2, cells), axis=1)
    values = stress.x.array[stress.function_space.dofmap.list[: len(cells)]].mean(axis=1)
    near = abs(r - PROBE) < width
    ratios = values[near] / solution.stress(r[near])
    total, n = domain.comm.allreduce(np.array([ratios.sum(), near.sum()]))
    return float(total / n)


STUDY = Study(
    "hub_torsion",
    "Torsion of a hub in a tensioned film",
    problem,
    {"law": list(LAWS), "element": ["P1", "P2"], "torque": [0.5, 1.5, 3.0], "nodes": [12, 24, 48]},
    lambda case: (RIM - HUB) / case["nodes"],
    (
        Measure(
            "θ/exact",
            1.0,
            1.5e-2,
            lambda case: 2.0,
            quick_tolerance=0.08,
            is_quick_asymptotic=False,
        ),
        Measure("σ1/exact", 1.0, 3e-2, quick_tolerance=0.08),
    ),
    quick={"law": ["Miyazaki 1e-6"], "torque": [1.5], "nodes": [6, 12]},
    columns="T/exact, iterations, seconds",
)
