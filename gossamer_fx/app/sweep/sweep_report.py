"""Tables of a robust design, and the picture of its main effects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.cases.results import Result, results_as_csv, value_text, values_text
from gossamer_fx.analysis.cases.shared_runs import SharedRuns
from gossamer_fx.app.sweep.robust_design import RobustDesign
from gossamer_fx.core.checks.errors import on_rank_zero
from gossamer_fx.records.outputs.output import make_parent, replace_file

# Sizes of the picture [inch]: of a panel, and of the margins for labels.
PANEL_WIDTH = 1.5
PANEL_HEIGHT = 2.2
LEFT_MARGIN = 1.2
BOTTOM_MARGIN = 0.4
RESOLUTION = 150  # dots per inch

# What is better, in the headings of the tables, by goal.
BETTER = {"smaller": "smaller", "larger": "larger", "nominal": "alike"}


def run_design(design: RobustDesign, comm: MPI.Intracomm, folder: Path) -> str:
    """Make the runs of a design that its folder lacks, then those that confirm it.

    Writes runs.csv, sweep.md and main_effects.png.  Processes that run the same design in the same
    folder share the runs.  A run whose step or equilibrium fails is reported and does not end the
    sweep; any other exception of an outcome ends it before the reports are written.  Collective.

    Args:
        design: what to run.
        comm: ranks that make a run together.
        folder: of runs and reports.

    Returns:
        The tables in Markdown, as in sweep.md.

    Raises:
        InputError: the folder cannot be written, or the outcome refuses values.
    """
    # A table that cannot be written is refused before the runs.
    make_parent(comm, folder / "runs.csv", file=True)
    runs = SharedRuns(comm, folder / "runs", design.outcome)
    results = runs.results(design.cases())
    confirmed = runs.results(design.confirmations(results))
    text = tables(design, results, confirmed)

    def write() -> None:
        replace_file(folder / "runs.csv", results_as_csv(results + confirmed))
        replace_file(folder / "sweep.md", text)
        draw(design, results, folder / "main_effects.png")

    on_rank_zero(comm, write)
    return text


def tables(design: RobustDesign, results: Sequence[Result], confirmed: Sequence[Result]) -> str:
    """Runs, effects and confirmation of a robust design in Markdown.

    Args:
        design: that was run.
        results: of its `cases()`.
        confirmed: of its `confirmations(results)`.

    Raises:
        InputError: all runs of a factor failed.
    """
    failed = [result for result in results if result.failed]
    seconds = sum(result.seconds for result in (*results, *confirmed))
    lines = [
        f"{design.array}: {len(results)} runs and {len(confirmed)} to confirm, "
        f"{seconds:.0f} s; {len(failed)} failed."
    ]
    for result in failed:
        lines.append(f"- {values_text(result.values)}: {result.failed}")
    for goal in design.goals:
        lines += _effects_table(design, results, goal)
    lines += _confirmation_table(design, results, confirmed)
    return "\n".join(lines) + "\n"


def _effects_table(design: RobustDesign, results: Sequence[Result], goal: str) -> list[str]:
    """Effects [dB] and shares of the control factors, and the best levels, for one goal: Markdown
    lines.

    Args:
        results: of its `cases()`, in order.

    Raises:
        InputError: all runs of a factor failed.
    """
    shares = design.shares(results, goal)
    lines = [
        "",
        f"## {goal}: {BETTER[design.goals[goal]]} is better",
        "",
        "| factor | mean S/N [dB] at each level | share |",
        "|---|---|---|",
    ]
    for name, effect in design.effects(results, goal).items():
        entries = []
        for level, ratio in zip(design.control[name], effect, strict=True):
            entries.append(f"{value_text(level)}: {ratio:.2f}")
        lines.append(f"| {name} | {', '.join(entries)} | {shares[name]:.0%} |")
    # Failed runs make the shares estimates, whose sum may exceed one.
    interactions = max(1 - sum(shares.values()), 0)
    lines.append(f"| interactions | | {interactions:.0%} |")
    lines += ["", f"Best levels: {values_text(design.best(results, goal))}."]
    return lines


def _confirmation_table(
    design: RobustDesign, results: Sequence[Result], confirmed: Sequence[Result]
) -> list[str]:
    """Predicted and found ratios [dB] at the usual and at the best levels, for the first goal.

    Args:
        results: of its `cases()`, in order.
        confirmed: of its `confirmations(results)`, in order.

    Returns:
        lines of Markdown.

    Raises:
        InputError: all runs of a factor failed.
    """
    goal = next(iter(design.goals))
    lines = [
        "",
        f"## Confirmation for {goal}",
        "",
        "| levels | S/N predicted [dB] | S/N found [dB] | mean |",
        "|---|---|---|---|",
    ]
    found = design.ratios(confirmed, goal)
    # The first half of the runs has the usual levels, the second half the best ones.
    half = len(confirmed) // 2
    groups = [
        ("usual", design.before(), confirmed[:half]),
        ("best", design.best(results, goal), confirmed[half:]),
    ]
    for k, (which, levels, group) in enumerate(groups):
        mean = np.mean([result.numbers.get(goal, np.nan) for result in group])
        predicted = design.predicted(results, goal, levels)
        lines.append(
            f"| {which}: {values_text(levels)} | {predicted:.2f} | {found[k]:.2f} | {mean:.4g} |"
        )
    return lines


def draw(design: RobustDesign, results: Sequence[Result], path: Path) -> None:
    """Draw the main effects: a row of panels for each goal, a panel for each control factor.

    The ratios of rows with a failed run are NaN.  They are left out of the means; a level of which
    all rows failed leaves a gap.

    Args:
        design: that was run.
        results: of its `cases()`, in order.
        path: of the PNG.

    Raises:
        OSError: the file cannot be written.
        ValueError: a ratio is not defined, see `RobustDesign.ratios`.
    """
    # Imported here, as only rank 0 of a sweep needs it.
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    rows = len(design.goals)
    columns = len(design.control)
    figure, axes = pyplot.subplots(
        rows,
        columns,
        figsize=(PANEL_WIDTH * columns + LEFT_MARGIN, PANEL_HEIGHT * rows + BOTTOM_MARGIN),
        sharey="row",
        squeeze=False,
        layout="constrained",
    )
    for panels, goal in zip(axes, design.goals, strict=True):
        mean = np.nanmean(design.ratios(results, goal))
        effects = design.effects(results, goal)
        for panel, (name, effect) in zip(panels, effects.items(), strict=True):
            _draw_panel(panel, name, design.control[name], effect, mean)
        panels[0].set_ylabel(f"{goal}\nS/N [dB]", fontsize=9)
    figure.savefig(path, dpi=RESOLUTION)
    pyplot.close(figure)


def _draw_panel(
    panel: Any,
    name: str,
    levels: Sequence[Any],
    effect: Any,
    mean: Any,
) -> None:
    """Draw the effects of the levels of one factor, and the mean of all runs.

    Args:
        effect: (k,) [dB]; NaN leaves a gap.
        mean: of all runs [dB].
    """
    panel.axhline(mean, color="#b8bec4", linewidth=1)
    panel.plot(range(len(effect)), effect, "o-", color="#0072B2", markersize=4)
    panel.set_xticks(range(len(effect)), [value_text(level) for level in levels], fontsize=8)
    panel.set_xlim(-0.4, len(effect) - 0.6)
    panel.set_title(name, fontsize=9)
    panel.tick_params(axis="y", labelsize=8)
    panel.spines[["top", "right"]].set_visible(False)
