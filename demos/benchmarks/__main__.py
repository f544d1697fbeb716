"""Compare run times with peers: ./gossamer bench NAME [--quick] [--runs N]; NAME is one of the problems, or all.

The programs take turns, one thread each; of every figure the median over the runs is shown, times next to results.
Writes out/benchmarks/NAME.csv, and ends with a line `ratio PEER NUMBER` for each peer: its cost over this program's,
the smallest over the cases.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from contestants import SELF, Failed, run

Case = dict[str, object]
Figures = dict[str, float]


@dataclass(frozen=True)
class Problem:
    """What is solved, by whom, and what it costs.

    `cases` and `quick` name each size and give the words for each program; `cost` is what the ratio compares.  A
    `chart` shows this program's cost and memory over the unknowns, with their exponents.  `script` names the problem
    whose scripts are run, if it is another one.
    """

    title: str
    cost: Callable[[Figures], float]
    unit: str
    cases: dict[str, dict[str, Case]]
    quick: dict[str, dict[str, Case]]
    seconds: float = 1800.0
    peers: tuple[str, ...] = ("kratos",)
    chart: bool = False
    script: str = ""


def sheets(sizes: dict[int, tuple[int, int, str]]) -> dict[str, dict[str, Case]]:
    """Cells of a side: steps with wrinkling and without it, Kratos' linear solver."""
    return {
        f"n = {n}, {'wrinkling' if wrinkling else 'linear'}": {
            SELF: {"n": n, "steps": steps[1 - wrinkling], "wrinkling": wrinkling},
            "kratos": {"n": n, "steps": steps[1 - wrinkling], "wrinkling": wrinkling, "solver": steps[2]},
        }
        for n, steps in sizes.items()
        for wrinkling in (1, 0)
    }


PROBLEMS = {
    "sheet": Problem(
        title="Free spinning sheet, h = 1e-3 s",
        cost=lambda r: 1e6 * r["cpu"] / r["steps"] / r["dofs"],
        unit="µs CPU per step and unknown",
        cases=sheets({40: (20, 20, "sparse_lu"), 80: (5, 5, "sparse_lu"), 160: (2, 2, "amgcl")}),
        quick=sheets({20: (10, 10, "sparse_lu")}),
    ),
    "airbag": Problem(
        title="Square airbag at rest, w_M = 0.2164 m within 0.5 %",
        cost=lambda r: r["cpu"],
        unit="s CPU",
        cases={"8 and 16 cells": {SELF: {"n": 8}, "kratos": {"n": 16}}},
        quick={"8 and 8 cells": {SELF: {"n": 8}, "kratos": {"n": 8}}},
    ),
    "scaling": Problem(
        title="Free spinning sheet, three steps of 1e-3 s, by this program alone",
        cost=lambda r: r["cpu"] / r["steps"],
        unit="s CPU per step",
        cases={f"n = {n}": {SELF: {"n": n, "steps": 3}} for n in (40, 80, 160, 318, 577)},
        quick={f"n = {n}": {SELF: {"n": n, "steps": 3}} for n in (40, 80)},
        peers=(),
        chart=True,
        script="sheet",
    ),
    "pendulum": Problem(
        title="Antenna pendulum, film off the surface of its corners",
        cost=lambda r: r["cpu"],
        unit="s CPU",
        cases={
            "until 0.5 s": {
                SELF: {"n": 12, "elements": 12, "order": 1, "until": 0.5},
                "exudyn": {"n": 9, "elements": 18, "until": 0.5},
            }
        },
        quick={
            "until 0.5 s": {
                SELF: {"n": 6, "elements": 6, "order": 1, "until": 0.5},
                "exudyn": {"n": 6, "elements": 12, "until": 0.5},
            }
        },
        peers=("exudyn",),
    ),
}


def compare(name: str, cases: dict[str, dict[str, Case]], runs: int, folder: Path) -> None:
    """Let the programs take turns, and show what they needed."""
    problem = PROBLEMS[name]
    print(f"{problem.title}; {problem.unit}, median of {runs}")
    smallest: dict[str, float] = {}
    rows: list[dict[str, object]] = []
    for label, case in cases.items():
        measured: dict[str, list[Figures]] = {program: [] for program in case}
        for _ in range(runs):
            for program, given in case.items():
                try:
                    measured[program].append(run(problem.script or name, program, given, problem.seconds))
                except Failed as failure:
                    print(f"{label:20} {program:10} failed: {failure}")
                    rows.append({"case": label, "program": program, "failure": str(failure)})
        costs: dict[str, float] = {}
        for program, results in measured.items():
            if results:
                middle = {key: median(r[key] for r in results) for key in results[0]}
                costs[program] = median(map(problem.cost, results))
                rest = "  ".join(f"{key} {value:.4g}" for key, value in middle.items())
                print(f"{label:20} {program:10} {costs[program]:10.4g}   {rest}", flush=True)
                rows.append({"case": label, "program": program, "cost": costs[program], **middle})
        for peer in problem.peers:
            if peer in costs and SELF in costs:
                ratio = costs[peer] / costs[SELF]
                smallest[peer] = min(ratio, smallest.get(peer, ratio))
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f"{name}.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, list(dict.fromkeys(key for row in rows for key in row)))
        table.writeheader()
        table.writerows(rows)
    solved = [row for row in rows if "dofs" in row]
    if problem.chart and len(solved) > 1:
        draw(problem, solved, folder / f"{name}.png")
    for peer in problem.peers:
        print(f"ratio {peer} {smallest[peer]:.3g}" if peer in smallest else f"no ratio to {peer}: it failed")


def draw(problem: Problem, rows: list[dict[str, object]], path: Path) -> None:
    """Cost and memory over the unknowns, double logarithmic; prints their exponents."""
    import matplotlib.pyplot as plt
    import numpy as np

    dofs, cost, newton, memory = (
        np.array([float(str(row[key])) for row in rows]) for key in ("dofs", "cost", "Newton/step", "MB")
    )
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
    for axes, values, label in (
        (left, cost, "step"),
        (left, cost / newton, "Newton iteration"),
        (right, memory, "process"),
    ):
        exponent = np.polyfit(np.log(dofs), np.log(values), 1)[0]
        axes.loglog(dofs, values, "o-", label=f"{label}, exponent {exponent:.2f}")
        print(f"exponent of a {label}: {exponent:.3f}")
    print(f"memory: {(memory[-1] - memory[0]) * 2**20 / (dofs[-1] - dofs[0]):.0f} bytes per unknown")
    for axes, label in ((left, problem.unit), (right, "memory [MB]")):
        axes.set(xlabel="unknowns", ylabel=label)
        axes.grid(which="both", alpha=0.3)
        axes.legend()
    figure.savefig(path)


def main() -> int:
    parser = argparse.ArgumentParser(prog="gossamer bench", description=__doc__.splitlines()[0])
    parser.add_argument("name", choices=[*PROBLEMS, "all"])
    parser.add_argument("--quick", action="store_true", help="one small case")
    parser.add_argument("--runs", type=int, default=3, help="of which the median is taken")
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"), help="folder of the tables")
    wanted = parser.parse_args()
    for name in PROBLEMS if wanted.name == "all" else [wanted.name]:
        compare(name, PROBLEMS[name].quick if wanted.quick else PROBLEMS[name].cases, wanted.runs, wanted.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
