"""What is compared: the problems, their sizes, who solves them, and what it costs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from contestants import SELF

Words = dict[str, object]  # words of a script; see contestants.run
Cases = dict[str, dict[str, Words]]  # by size, then by contestant
Figures = dict[str, float]

# Largest closing error of the energy, relative, of runs that conserve it.
CLOSES = {"ΔE/E": 1e-8}

# Of the plates of Sze, Liu & Lo.
WITHOUT_UNITS = {"numbers are in SI units": "the problem is published without units"}

# A complete factorisation instead of the solver that is chosen.
DIRECT: Words = {
    "PETSC_OPTIONS": "-gx_ksp_type preonly -gx_pc_type lu -gx_pc_factor_mat_solver_type mumps"
}


@dataclass(frozen=True)
class Problem:
    """What is solved, by whom, and what it costs.

    `cases` and `quick` name each size and give the words for each contestant; `cost` is what the
    ratio to the `peers` compares.  `equal` are results in which all must agree, with the largest
    relative difference, and `limits` the largest errors of this program.  A `chart` shows this
    program's cost and memory over the unknowns, with their exponents.  `script` names the problem
    whose scripts are run, if it is another one.  `expected_warnings` are reasons by a part of the
    text of a warning of this program.
    """

    title: str
    cost: Callable[[Figures], float]
    unit: str
    cases: Cases
    quick: Cases
    seconds: float = 1800.0
    peers: tuple[str, ...] = ()
    equal: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    expected_warnings: Mapping[str, str] = field(default_factory=dict)
    chart: bool = False
    script: str = ""


def sheets(sizes: dict[int, tuple[int, int, str]]) -> Cases:
    """Cells of a side: steps of each program, Kratos' linear solver; both stop at 1e-6 of a step's
    first residual."""
    return {
        # Without wrinkling the law is linear elastic, and both programs have the same problem.
        f"n = {n}, {'wrinkling' if wrinkling else 'linear'}": {
            SELF: {"n": n, "steps": own, "wrinkling": wrinkling, "relative": 1e-6},
            "kratos": {"n": n, "steps": steps, "wrinkling": wrinkling, "solver": solver},
        }
        for n, (own, steps, solver) in sizes.items()
        for wrinkling in (1, 0)
    }


def alone(word: str, sizes: tuple[int, ...], **more: object) -> Cases:
    """Sizes of this program, by the word that names them."""
    return {f"{word} = {size}": {SELF: {word: size, **more}} for size in sizes}


def ranks(pairs: dict[str, tuple[int, int]], steps: int) -> Cases:
    """Cells of a side on one rank and on two."""
    return {
        label: {
            # Two labels of this program: its figures on one rank are the reference.
            "one-rank": {"n": one, "steps": steps},
            SELF: {"n": two, "steps": steps, "ranks": 2},
        }
        for label, (one, two) in pairs.items()
    }


def fabric_airbags(dampings: dict[tuple[int, int], float]) -> Cases:
    """Cells along half an edge, and the angle of the yarns from the edges, with the damping [1/s]
    of Kratos.

    With that of the isotropic airbag (60/s), and of 16 cells at 45 degrees with 1000/s, it loses
    its shape.
    """
    return {
        f"{n} cells, {angle} degrees": {
            SELF: {"n": n, "law": "fabric", "angle": angle},
            "kratos": {"n": n, "law": "fabric", "angle": angle, "damping": damping},
        }
        for (n, angle), damping in dampings.items()
    }


def strips(own: int, kratos: tuple[int, int], exudyn: int, ngsolve: int) -> dict[str, Words]:
    """Cells along, and as few increments of the load as succeed; of Kratos cells and increments."""
    return {
        # Fewest cells and increments with which each program reaches the error.
        SELF: {"n": own, "step": 1e4},
        "kratos": {"n": kratos[0], "increments": kratos[1]},
        "exudyn": {"n": exudyn, "increments": 1},
        "ngsolve": {"n": ngsolve, "increments": 1},
    }


def rings(n: int) -> dict[str, Words]:
    """Cells across a half of the ring; the peers need many increments, the first of them small."""
    return {
        # The load grows with the third power: the first increments are the hardest.
        SELF: {"shape": "slit ring", "n": n},
        "kratos": {"shape": "slit ring", "n": n, "increments": 40, "power": 3.0},
        "ngsolve": {"shape": "slit ring", "n": n // 2, "increments": 30, "power": 3.0},
    }


PROBLEMS = {
    "sheet": Problem(
        title="Free spinning sheet, h = 1e-3 s",
        # Seconds per step and unknown are comparable between meshes.
        cost=lambda r: 1e6 * r["cpu"] / r["steps"] / r["dofs"],
        unit="µs CPU per step and unknown",
        # Kratos takes a factorisation up to 5 k unknowns, then algebraic multigrid.
        cases=sheets({40: (20, 20, "sparse_lu"), 80: (5, 5, "amgcl"), 160: (2, 2, "amgcl")}),
        quick=sheets({20: (10, 10, "sparse_lu")}),
        limits=CLOSES,
        peers=("kratos",),
    ),
    "airbag": Problem(
        title="Square airbag at rest, w_M = 0.2164 m within 0.5 %",
        cost=lambda r: r["cpu"],
        unit="s CPU",
        cases={f"{n} cells": {SELF: {"n": n}, "kratos": {"n": n}} for n in (8, 16)},
        quick={"8 cells": {SELF: {"n": 8}, "kratos": {"n": 8}}},
        peers=("kratos",),
    ),
    "airbag_fabric": Problem(
        title=(
            "Square airbag of fabric at rest, w_M = 0.2220 m (0 degrees) and 0.2196 m (45 degrees)"
        ),
        cost=lambda r: r["cpu"],
        unit="s CPU",
        cases=fabric_airbags({(8, 0): 1000, (8, 45): 1000, (16, 0): 1000, (16, 45): 2000}),
        quick=fabric_airbags({(8, 0): 1000, (8, 45): 1000}),
        peers=("kratos",),
        script="airbag",
    ),
    "orthotropic": Problem(
        title=(
            "Free sheet, law time of a Newton iteration of orthotropic film over that of isotropic "
            "film"
        ),
        cost=lambda r: r["ratio"],
        unit="times",
        # On order 2 half as many cells, hence as many unknowns.
        cases={
            f"{law}, order {order}": {SELF: {"law": law, "order": order, "n": 48 // order}}
            for order in (1, 2)
            for law in ("fabric", "braid", "steep braid")
        },
        quick={"braid, order 1": {SELF: {"law": "braid", "n": 10, "steps": 3}}},
    ),
    "plate": Problem(
        title="Cantilever strip and slit ring of Sze, Liu & Lo (2004) under their full load",
        cost=lambda r: r["cpu"],
        unit="s CPU",
        cases={
            "strip, 1 %": strips(6, (4, 4), 2, 2),
            "strip, 0.1 %": strips(20, (12, 4), 4, 2),
            "slit ring, 3 %": rings(8),
            "slit ring, 1 %": rings(16),
        },
        quick={"strip, 1 %": strips(6, (4, 4), 2, 2)},
        expected_warnings=WITHOUT_UNITS,
        # A peer that has no result by then counts as failed.
        seconds=300.0,
        peers=("kratos", "exudyn", "ngsolve"),
    ),
    "pendulum": Problem(
        title="Antenna pendulum, film equally far off the surface of its corners",
        cost=lambda r: r["cpu"],
        unit="s CPU",
        # Resolutions at which the film's deflection agrees, see `equal`.
        cases={
            "until 0.5 s": {
                SELF: {"n": 3, "elements": 6, "order": 2, "dt": 2e-2, "until": 0.5},
                "exudyn": {"n": 9, "elements": 9, "dt": 5e-3, "until": 0.5},
            },
            "until 2 s": {
                SELF: {"n": 9, "elements": 6, "order": 1, "dt": 1e-2, "until": 2.0},
                "exudyn": {"n": 9, "elements": 9, "dt": 5e-3, "until": 2.0},
            },
        },
        quick={
            "until 0.5 s": {
                SELF: {"n": 6, "elements": 6, "order": 1, "dt": 2e-2, "until": 0.5},
                "exudyn": {"n": 6, "elements": 6, "dt": 5e-3, "until": 0.5},
            }
        },
        peers=("exudyn",),
        equal={"film, rms [mm]": 0.02},
    ),
    "scaling": Problem(
        title="Free spinning sheet, three steps of 1e-3 s",
        cost=lambda r: r["cpu"] / r["steps"],
        unit="s CPU per step",
        cases=alone("n", (40, 80, 160, 318, 577), steps=3),
        quick=alone("n", (40, 80), steps=3),
        limits=CLOSES,
        chart=True,
        script="sheet",
    ),
    "tube": Problem(
        title="Tube of the demo inflate_tube, its first 20 steps of 1e-4 s",
        cost=lambda r: r["cpu"] / r["steps"],
        unit="s CPU per step",
        cases=alone("cells", (10, 20, 40), steps=20),
        quick=alone("cells", (6, 10), steps=5),
        limits=CLOSES,
        chart=True,
    ),
    "antenna": Problem(
        title=(
            "Antenna of the demo antenna_pendulum, tied by multipliers, its first 3 steps of 5e-3 s"
        ),
        cost=lambda r: r["cpu"] / r["steps"],
        unit="s CPU per step",
        cases=alone("cells", (40, 80, 160, 280), steps=3),
        quick=alone("cells", (6, 12), steps=3),
        limits=CLOSES,
        chart=True,
    ),
    "contact": Problem(
        title="A film of 0.2 m thrown at another one at 2 m/s, for 10 ms",
        cost=lambda r: r["cpu"],
        unit="s CPU",
        cases={
            f"{n} x {n} cells": {
                # newton's usual step; then a tenth of it, and five times as many sweeps.
                SELF: {"n": n},
                "newton": {"n": n},
                "newton, h/10": {"n": n, "dt": 1e-5},
                "newton, 100 sweeps": {"n": n, "iterations": 100},
            }
            for n in (10, 20)
        },
        quick={"4 x 4 cells": {SELF: {"n": 4}, "newton": {"n": 4}}},
        limits=CLOSES | {"penetrations": 0},
        peers=("newton",),
    ),
    "contact_cost": Problem(
        title=(
            "A stack of films, a Newton iteration with contact over one without; all of them "
            "packed, and a tenth"
        ),
        cost=lambda r: r["ratio"],
        unit="times",
        limits=CLOSES,
        cases={
            # All of the stack pressed together, and a tenth of it.
            f"{vertices / 1000:g}k, {part:g} packed": {SELF: {"vertices": vertices, "part": part}}
            for part in (1.0, 0.1)
            for vertices in (1000, 5000, 20000, 80000)
        },
        quick={"1k, 1 packed": {SELF: {"vertices": 1000, "part": 1.0}}},
    ),
    "gradient": Problem(
        title="A gradient by thousands of parameters, the pass backwards over the run",
        cost=lambda r: r["ratio"],
        unit="times the run",
        # dE/dv0 = M v0, taken back from the end; with friction there is no such exact value.
        limits={"energy's gradient off by": 1e-6},
        cases={
            f"{scene}, {n} x {n} cells": {SELF: {"scene": scene, "n": n}}
            for scene in ("sheet", "contact", "friction", "gas")
            # Parameters are the thickness and the velocities of every node.
            for n in (10, 20, 40)
        },
        quick={"sheet, 6 x 6 cells": {SELF: {"scene": "sheet", "n": 6, "steps": 10}}},
    ),
    "ranks": Problem(
        title="Free spinning sheet on two ranks and on one",
        cost=lambda r: r["wall"] / r["steps"],
        unit="s wall time per step",
        # The same mesh on one and on two ranks.
        cases=ranks({"78k": (160, 160), "300k": (315, 315)}, steps=3),
        quick=ranks({"5k": (40, 40)}, steps=3),
        peers=("one-rank",),
        equal={"energy": 1e-8, "stored": 1e-8},
        script="sheet",
    ),
    "weak": Problem(
        title="Free spinning sheet twice as large on two ranks",
        cost=lambda r: r["wall"] / r["steps"] / r["Newton/step"],
        unit="s wall time per Newton iteration",
        # Twice as many unknowns on two ranks: ideal is an equal time per Newton iteration.
        cases=ranks({"39k a rank": (113, 160), "78k a rank": (160, 227)}, steps=3),
        quick=ranks({"2.6k a rank": (28, 40)}, steps=3),
        peers=("one-rank",),
        script="sheet",
    ),
    "direct": Problem(
        title="Free spinning sheet, the solver that is chosen against a factorisation",
        cost=lambda r: r["cpu"] / r["steps"],
        unit="s CPU per step",
        # As many steps as the set-up of a preconditioner is used for.
        cases={"78k": {SELF: {"n": 160, "steps": 8}, "direct": {"n": 160, "steps": 8, **DIRECT}}},
        quick={"5k": {SELF: {"n": 40, "steps": 3}, "direct": {"n": 40, "steps": 3, **DIRECT}}},
        peers=("direct",),
        equal={"energy": 1e-8, "stored": 1e-8},
        script="sheet",
    ),
    "limit": Problem(
        title=(
            "Free spinning sheet, a Newton iteration over one tangent, one set-up, and the Krylov "
            "iterations' cycles"
        ),
        cost=lambda r: r["over limit"],
        unit="times the limit",
        cases=alone("n", (80, 160), steps=3),
        quick=alone("n", (40,), steps=3),
    ),
    "profile": Problem(
        title="Free spinning sheet, where the time of a Newton iteration goes",
        cost=lambda r: r["iteration [ms]"],
        unit="ms CPU per Newton iteration",
        cases=alone("n", (80, 160), steps=12),
        quick=alone("n", (40,), steps=3),
    ),
}
