"""Tables and the picture of main effects of a robust design."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.checks.errors import on_rank_zero
from gossamer_fx.sweep.robust_design import RobustDesign
from gossamer_fx.sweep.runs import Result, SharedRuns


def run_design(design: RobustDesign, comm: MPI.Intracomm, folder: Path) -> str:
    """Make the runs of a design that its folder lacks, and then those that confirm it; returns the tables.

    Writes runs.csv, sweep.md and main_effects.png.  Processes that run the same design in the same folder share it.
    """
    runs = SharedRuns(comm, folder / "runs", design.outcome)
    results = runs.results(design.cases())
    confirmed = runs.results(design.confirmations(results))
    text = tables(design, results, confirmed)

    def write() -> None:
        (folder / "runs.csv").write_text(_rows(results + confirmed))
        (folder / "sweep.md").write_text(text)
        draw(design, results, folder / "main_effects.png")

    on_rank_zero(comm, write)
    return text


def tables(design: RobustDesign, results: Sequence[Result], confirmed: Sequence[Result]) -> str:
    """Runs, effects and confirmation in Markdown."""
    failed = [result for result in results if result.failed]
    seconds = sum(result.seconds for result in (*results, *confirmed))
    lines = [
        f"{design.array}: {len(results)} runs and {len(confirmed)} to confirm, {seconds:.0f} s; {len(failed)} failed.",
        *(f"- {_words(result.values)}: {result.failed}" for result in failed),
    ]
    for goal, kind in design.goals.items():
        shares = design.shares(results, goal)
        lines += [
            "",
            f"## {goal}: {kind} is better" if kind != "nominal" else f"## {goal}: alike is better",
            "",
        ]
        lines += ["| factor | mean S/N [dB] at each level | share |", "|---|---|---|"]
        for name, effect in design.effects(results, goal).items():
            pairs = zip(design.control[name], effect, strict=True)
            told = ", ".join(f"{_plain(level)}: {ratio:.2f}" for level, ratio in pairs)
            lines.append(f"| {name} | {told} | {shares[name]:.0%} |")
        lines.append(f"| interactions | | {max(1 - sum(shares.values()), 0):.0%} |")
        lines += ["", f"Best levels: {_words(design.best(results, goal))}."]
    goal = next(iter(design.goals))
    lines += [
        "",
        f"## Confirmation for {goal}",
        "",
        "| levels | S/N predicted [dB] | S/N found [dB] | mean |",
        "|---|---|---|---|",
    ]
    half = len(confirmed) // 2
    found = design.ratios(confirmed, goal)
    for k, (which, levels) in enumerate(
        (("usual", design.before()), ("best", design.best(results, goal)))
    ):
        numbers = [
            result.numbers.get(goal, np.nan) for result in confirmed[k * half : (k + 1) * half]
        ]
        predicted = design.predicted(results, goal, levels)
        lines.append(
            f"| {which}: {_words(levels)} | {predicted:.2f} | {found[k]:.2f} | {np.mean(numbers):.4g} |"
        )
    return "\n".join(lines) + "\n"


def draw(design: RobustDesign, results: Sequence[Result], path: Path) -> None:
    """Main effects: a row of panels for each goal, a panel for each control factor."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    rows, columns = len(design.goals), len(design.control)
    figure, axes = pyplot.subplots(
        rows,
        columns,
        figsize=(1.5 * columns + 1.2, 2.2 * rows + 0.4),
        sharey="row",
        squeeze=False,
        layout="constrained",
    )
    for panels, goal in zip(axes, design.goals, strict=True):
        mean = np.nanmean(design.ratios(results, goal))
        for panel, (name, effect) in zip(
            panels, design.effects(results, goal).items(), strict=True
        ):
            panel.axhline(mean, color="#b8bec4", linewidth=1)
            panel.plot(range(len(effect)), effect, "o-", color="#0072B2", markersize=4)
            panel.set_xticks(
                range(len(effect)), [_plain(level) for level in design.control[name]], fontsize=8
            )
            panel.set_xlim(-0.4, len(effect) - 0.6)
            panel.set_title(name, fontsize=9)
            panel.tick_params(axis="y", labelsize=8)
            panel.spines[["top", "right"]].set_visible(False)
        panels[0].set_ylabel(f"{goal}\nS/N [dB]", fontsize=9)
    figure.savefig(path, dpi=150)
    pyplot.close(figure)


def _rows(results: Sequence[Result]) -> str:
    names = list(
        dict.fromkeys(name for result in results for name in (*result.values, *result.numbers))
    )
    text = io.StringIO()
    writer = csv.DictWriter(text, [*names, "seconds", "failed"])
    writer.writeheader()
    for result in results:
        writer.writerow(
            {**result.values, **result.numbers, "seconds": result.seconds, "failed": result.failed}
        )
    return text.getvalue()


def _words(values: dict[str, Any]) -> str:
    return ", ".join(f"{name} {_plain(value)}" for name, value in values.items())


def _plain(value: Any) -> str:
    return value if isinstance(value, str) else f"{value:g}"
