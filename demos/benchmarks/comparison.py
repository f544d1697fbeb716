"""Letting the contestants of a problem take turns, and telling what they needed."""

from __future__ import annotations

import csv
from pathlib import Path
from statistics import median

from charts import draw
from contestants import PACKAGES, SELF, Failed, run
from problems import Cases, Figures, Problem

Row = dict[str, object]


def compare(name: str, problem: Problem, cases: Cases, runs: int, folder: Path) -> dict[str, float]:
    """Solve the cases `runs` times, print and write medians to FOLDER/NAME.csv; ratio of each peer
    that succeeded."""
    print(f"{problem.title}; {problem.unit}, median of {runs}")
    ratios: dict[str, float] = {}
    rows: list[Row] = []
    for label, case in cases.items():
        measured = take_turns(
            problem.script or name,
            label,
            case,
            runs,
            problem.seconds,
            rows,
        )
        # Medians of each figure by itself, so that they may come from different runs.
        middle = {
            who: {key: median(r[key] for r in found) for key in found[0]}
            for who, found in measured.items()
        }
        costs = {who: median(map(problem.cost, found)) for who, found in measured.items()}
        for who, figures in middle.items():
            rest = "  ".join(f"{key} {value:.4g}" for key, value in figures.items())
            print(f"{label:20} {who:10} {costs[who]:10.4g}   {rest}", flush=True)
            rows.append({"case": label, "program": who, "cost": costs[who], **figures})
        for result in problem.equal:
            tell_difference(label, result, middle)
        for peer in problem.peers:
            if peer in costs and SELF in costs:
                # The smallest ratio of all cases: the one that flatters this program least.
                ratio = costs[peer] / costs[SELF]
                ratios[peer] = min(ratio, ratios.get(peer, ratio))
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f"{name}.csv").open("w", newline="") as file:
        # Programs report different figures; the table has a column for each.
        table = csv.DictWriter(file, list(dict.fromkeys(key for row in rows for key in row)))
        table.writeheader()
        table.writerows(rows)
    # Rows of failures have no figures.
    solved = [row for row in rows if "dofs" in row]
    if problem.chart and len(solved) > 1:
        draw(solved, problem.unit, folder / f"{name}.png")
    for peer in problem.peers:
        print(
            f"ratio {peer} {ratios[peer]:.3g}"
            if peer in ratios
            else f"no ratio to {peer}: it failed"
        )
    return ratios


def take_turns(
    script: str,
    label: str,
    case: dict[str, dict[str, object]],
    runs: int,
    seconds: float,
    rows: list[Row],
) -> dict[str, list[Figures]]:
    """What each contestant measured; failures are told and go into the rows."""
    measured: dict[str, list[Figures]] = {}
    # Contestants take turns in each round, so that a load on the machine meets all of them.
    for _ in range(runs):
        for who, given in case.items():
            try:
                program = who.split(",")[0]  # a peer may come in several ways
                figures = run(script, program if program in PACKAGES else SELF, given, seconds)
                measured.setdefault(who, []).append(figures)
            except Failed as failure:
                print(f"{label:20} {who:10} failed: {failure}", flush=True)
                rows.append({"case": label, "program": who, "failure": str(failure)})
    return measured


def tell_difference(label: str, result: str, found: dict[str, Figures]) -> None:
    """By how much a result of the others differs from this program's, relative."""
    if SELF in found:
        own = found[SELF][result]
        for who, figures in found.items():
            if who != SELF:
                print(
                    f"{label:20} {who:10} {result} differs by {abs(figures[result] / own - 1):.1e}",
                    flush=True,
                )
