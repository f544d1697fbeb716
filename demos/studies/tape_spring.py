"""A tape spring bent against its curvature: moment up to the snap, and after it.

A steel strip, curved across (R = 13.3 mm, 80°, t = 0.1 mm), is a plate with a rest curvature on a
flat mesh.  Its ends retain their shape and are turned by φ each, without axial force; by symmetry a
half is computed.  The moment follows from the energy, M = dU/d(2φ).

    peak     of uniform bending: the largest dU/dκ of the section under the curvature κ along the
             tape (Wüst, Z. Angew. Math. Mech. 34 (1954) 444; solved again below).  Ends that retain
             their shape make a short tape stiffer.
    plateau  of a fold, a cylinder of radius R about the other axis: M = (1+ν) D α (Seffen &
    Pellegrino, Proc. R. Soc.
             Lond. A 455 (1999) 1003)
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.searches import Effort
from demos.studies.engine.study import Measure, Study
from gossamer_fx.meshes.sheet import sheet

# Radius [m] and angle [rad] of the section, and half of the length [m].
RADIUS = 13.3e-3
ANGLE = math.radians(80)
HALF = 0.1
STEEL = gx.Linear(
    E=210e9,
    nu=0.3,
    density=7850.0,
    thickness=1e-4,
)
WIDTH = RADIUS * ANGLE
# Bending stiffness [N m] of the strip as a plate.
D = STEEL.E * STEEL.thickness**3 / 12 / (1 - STEEL.nu**2)
PLATEAU = (1 + STEEL.nu) * D * ANGLE
# Turns φ [rad] of an end.
TURNS = np.radians([0, 1, 2, 3, 4, 5, 6, 6.5, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16])
# Turn [rad] from which the moment is that of the fold.
FLAT = np.radians(13.0)
SEARCH = gx.analysis.Continuation(
    first_step=1e-3,
    tolerance=1e-6,
    inner_tolerance=0.3,
    fast_iterations=15,
    max_iterations=40,
)
# Axial force [N] that counts as zero.
LITTLE = 1e-3 * D * ANGLE / RADIUS
# Secant iterations for the shift of an end.
MAX_SECANT_STEPS = 12
# Largest change [m] of the shift in one of them, against steps over the snap.
MAX_SHIFT = 2e-3


def peak_of_section(n: int = 300) -> float:
    """Largest moment [N m] of uniform bending: with z and χ the height and the change of curvature
    of the section,

    U(κ) = min ∫ E t/2 κ² (z - mean)² + D/2 (κ² - 2ν κ χ + χ²) ds
    """
    s = np.linspace(-WIDTH / 2, WIDTH / 2, n + 1)
    h = s[1] - s[0]
    # Membrane stiffness [N/m] of the strip.
    E = STEEL.E * STEEL.thickness
    ν = STEEL.nu
    # Trapezoidal rule.
    weight = np.full(n + 1, h)
    weight[[0, -1]] /= 2
    before = np.eye(n - 1, n + 1)
    here = np.eye(n - 1, n + 1, 1)
    after = np.eye(n - 1, n + 1, 2)
    second = (before - 2 * here + after) / h**2
    # Takes the mean off a function.
    mean = np.outer(np.ones(n + 1), weight) / WIDTH
    centred = np.eye(n + 1) - mean
    z0 = centred @ (RADIUS * (1 - np.cos(s / RADIUS)))

    def energy(κ: float) -> float:
        """U(κ) [J/m]: the minimum over the deflection w (n + 1,) [m] of the section."""
        along = E * κ**2 * centred.T @ (weight[:, None] * centred)
        K = along + D * h * second.T @ second
        # The energy does not change with a constant w, which makes K singular.
        K += 1e-9 * np.trace(K) / n**2
        by_poisson = D * ν * κ * h * second.sum(axis=0)
        w = np.linalg.solve(K, by_poisson - along @ z0)
        z = centred @ (z0 + w)
        χ = second @ w
        stretching = E / 2 * κ**2 * (weight * z * z).sum()
        bending = D / 2 * h * (κ**2 - 2 * ν * κ * χ + χ**2).sum()
        return float(stretching + bending)

    curvatures = np.linspace(0.05, 4, 80)
    return float(np.gradient([energy(κ) for κ in curvatures], curvatures).max())


def section(X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacements [m] along y and z of points (3, n) of a flat strip that give it the section."""
    a = X[1] / RADIUS - ANGLE / 2
    return RADIUS * (np.sin(a) + ANGLE / 2) - X[1], RADIUS * (1 - np.cos(a))


def tape_of(comm: MPI.Comm, length: float, along: int, across: int, **start: Any) -> gx.Plate:
    """A tape of a length [m] with so many cells along it and across; `start`, e.g. a velocity, is
    of the plate."""
    return gx.Plate(
        sheet(comm, along, across, length, WIDTH, crossed=True),
        STEEL,
        rest_curvature=np.diag((0.0, 1 / RADIUS, 0.0)),
        displacement=lambda X: np.stack([0 * X[0], *section(X)]),
        **start,
    )


def problem(comm: MPI.Comm, cells: int) -> dict[str, float]:
    """`cells` across."""
    height = RADIUS * (1 - math.sin(ANGLE / 2) / (ANGLE / 2))  # of the mean of the section
    shift = 0.0

    def turned(X: np.ndarray, φ: float) -> np.ndarray:
        y, z = section(X)
        return np.stack(
            [shift + (z - height) * math.sin(φ), y, height + (z - height) * math.cos(φ)]
        )

    def direction(X: np.ndarray, φ: float) -> np.ndarray:
        return np.stack([math.cos(φ) + 0 * X[0], 0 * X[0], -math.sin(φ) + 0 * X[0]])

    tape = tape_of(comm, HALF, 5 * cells // 2, cells)
    middle = gx.Fixed(
        tape,
        "left",
        rotation=True,
        components=(0,),
        direction=(1.0, 0.0, 0.0),
        name="middle",
    )
    end = gx.Fixed(
        tape,
        "right",
        rotation=True,
        direction=direction,
        motion=turned,
        name="end",
    )
    equilibrium = gx.Equilibrium(gx.Scene(tape, middle, end), SEARCH)
    energies = []
    effort = Effort()
    # First guess of the axial stiffness [N/m]: that of a straight strip.
    stiffness = STEEL.E * STEEL.thickness * WIDTH / HALF
    for φ in TURNS:
        before = None
        step = 0.0
        # A secant iteration for the shift [m] without axial force.
        for _ in range(MAX_SECANT_STEPS):
            found = effort.add(equilibrium.find(at=float(φ)))
            force = equilibrium.reaction(end)[0][0]
            if before is not None and before != force:
                secant = (force - before) / step
                # Past the snap a secant may be negative and lead away.
                if secant > 1e-3 * stiffness:
                    stiffness = secant
            if abs(force) < LITTLE:
                break
            before = force
            step = float(np.clip(-force / stiffness, -MAX_SHIFT, MAX_SHIFT))
            shift += step
        # Of both halves.
        energies.append(2 * sum(found.totals.stored.values()))
    moments = np.diff(energies) / np.diff(2 * TURNS)
    fold = TURNS >= FLAT
    plateau = float(np.polyfit(2 * TURNS[fold], np.array(energies)[fold], 1)[0])
    return {
        "peak/section's": float(moments.max()) / peak_of_section(),
        "plateau/(1+ν)Dα": plateau / PLATEAU,
        "peak [N m]": float(moments.max()),
        **vars(effort),
    }


STUDY = Study(
    "tape_spring",
    "A tape spring bent against its curvature",
    problem,
    {"cells": [8]},
    lambda case: WIDTH / case["cells"],
    (
        Measure("peak/section's", 1.0, 0.15),
        Measure("plateau/(1+ν)Dα", 1.0, 0.05, quick_tolerance=0.3),
    ),
    quick={"cells": [4]},
    columns="peak [N m], iterations, seconds",
    expected_warnings={
        "The equilibrium is not stable": "some shifts that are tried while the tape snaps"
    },
)
