"""A table and a picture of all cases by family, in which every miss is seen."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from demos.validation.engine.case import Case
from demos.validation.engine.comparison import Comparison, comparisons, results_by_test
from demos.validation.engine.intervals import VERDICTS, Interval, verdict_cells
from demos.validation.engine.report import is_asked, percent
from gossamer_fx.extend import Result, markdown_table

HEAD = [
    "family",
    "cases",
    "compared",
    "least error",
    "largest error",
    "of",
    "as asked",
    "peer's error",
]

# Predicted over measured at the edges of the picture, unless errors are larger.  The axis is
# logarithmic, so that twice and half as much are equally far from the line.
LEAST_RANGE = 1.7
# Marks beyond this ratio are drawn at the edge, with their number.
LARGEST_RANGE = 3.0
TICKS = (0.35, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.25, 1.4, 1.6, 2.0, 2.8)

# Size of the picture [in]; each family has a column of one width, whatever the number of its marks.
COLUMN_WIDTH = 1.25
MARGIN = 1.0
HEIGHT = 4.2

# Colours that are told apart also without red and green.
AS_ASKED = "tab:blue"
MISSED = "tab:red"
NOT_ASKED = "0.6"
# How the mark of a peer looks.
PEER = {"marker": "D", "color": "black", "markersize": 4, "fillstyle": "none", "linestyle": ""}


@dataclass(frozen=True)
class Mark:
    """One quantity of one test: what the picture shows of it.

    Attributes:
        case: its name.
        comparison: of predicted and measured values.
    """

    case: str
    comparison: Comparison

    @property
    def ratios(self) -> np.ndarray:
        """Predicted over measured values (n,), as 1 plus the relative errors."""
        # Not by division: a case may relate errors to another number than the measured value.
        signs = np.where(self.comparison.y_measured < 0, -1, 1)
        return 1 + signs * self.comparison.errors

    @property
    def side(self) -> int:
        """1 if the prediction is too large on average, or else -1."""
        return 1 if float(self.ratios.mean()) >= 1 else -1

    @property
    def ratio(self) -> float:
        """1 plus or minus the error that is judged; errors of both signs do not cancel."""
        return 1 + self.side * abs(self.comparison.error)

    @property
    def peer_ratio(self) -> float:
        """1 plus or minus the error of the peer, on the side of the prediction, as it has no
        sign."""
        return 1 + self.side * self.comparison.measured.peer_error


def marks_by_family(cases: Iterable[tuple[Case, list[Result]]]) -> dict[str, list[Mark]]:
    """All compared quantities, the families in alphabetical order."""
    found: dict[str, list[Mark]] = {}
    for case, results in sorted(cases, key=lambda entry: entry[0].family):
        for test, result in results_by_test(case, results):
            marks = [Mark(case.name, comparison) for comparison in comparisons(test, result)]
            found.setdefault(case.family, []).extend(marks)
    return found


COUNT_HEAD = [
    "kind of quantity",
    "compared with experiments",
    "as near as asked",
    "median error [%]",
    "90th percentile [%]",
    *VERDICTS,
]


def is_right(comparison: Comparison) -> bool:
    """Whether a prediction is as near as was asked, on a mesh that is fine enough to say so."""
    return comparison.is_accepted() and not comparison.measured.not_converged


def counted(cases: Iterable[tuple[Case, list[Result]]], evidence: str) -> list[Mark]:
    """The quantities of which something was asked, compared with one kind of evidence, without
    those that are not predictions."""
    return [
        mark
        for marks in marks_by_family(cases).values()
        for mark in marks
        if is_asked(mark.comparison.measured)
        and mark.comparison.measured.evidence == evidence
        and not mark.comparison.measured.not_counted
    ]


def count_rows(
    cases: Iterable[tuple[Case, list[Result]]],
    intervals: Mapping[str, Sequence[Interval | None]],
) -> Iterator[list[str]]:
    """Cells of the table that counts experiments by the kind of quantity; first the headings.

    Args:
        cases: with their results.
        intervals: of the same quantities, by kind.
    """
    yield COUNT_HEAD
    marks = counted(cases, "experiment")
    kinds = sorted({mark.comparison.measured.kind for mark in marks})
    groups = {kind: [m for m in marks if m.comparison.measured.kind == kind] for kind in kinds}
    every = [one for group in intervals.values() for one in group]
    by_kind = {**intervals, "all": every}
    for kind, group in {**groups, "all": marks}.items():
        errors = [abs(mark.comparison.error) for mark in group]
        yield [
            kind,
            str(len(group)),
            str(sum(is_right(mark.comparison) for mark in group)),
            f"{100 * np.median(errors):.1f}",
            f"{100 * np.percentile(errors, 90):.0f}",
            *verdict_cells(by_kind[kind]),
        ]


def accuracy_words(
    cases: Sequence[tuple[Case, list[Result]]],
    intervals: Mapping[str, Sequence[Interval | None]],
) -> str:
    """The count of experiments as a table, and sentences about the worst miss, the other evidence
    and what is not counted."""
    experiments = counted(cases, "experiment")
    worst = max(experiments, key=lambda mark: abs(mark.comparison.error))
    error = percent(abs(worst.comparison.error)) or "failed"
    others = []
    for evidence, words in (("theory", "theory"), ("program", "tests of other programs")):
        found = counted(cases, evidence)
        right = sum(is_right(mark.comparison) for mark in found)
        others.append(f"{right} of {len(found)} with {words}")
    left_out = sum(
        is_asked(mark.comparison.measured) and bool(mark.comparison.measured.not_counted)
        for marks in marks_by_family(cases).values()
        for mark in marks
    )
    return (
        f"{markdown_table(count_rows(cases, intervals))}\n"
        f"The worst miss is {error}: the quantity *{worst.comparison.measured.quantity}* of the "
        f"case `{worst.case}`.\n"
        "Comparisons that are not with experiments are counted apart: "
        f"{' and '.join(others)} are as near as asked.\n"
        f"{left_out} quantities are not counted, as they were calibrated on what they are compared "
        "with, or need no solver."
    )


def overview(cases: Iterable[tuple[Case, list[Result]]], path: Path) -> None:
    """Draw predicted over measured, one mark for each quantity of each test."""
    # Loaded here, as tables need no pictures; "Agg" needs no screen.
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    families = marks_by_family(cases)
    width = MARGIN + COLUMN_WIDTH * len(families)
    drawing, axis = pyplot.subplots(
        figsize=(width, HEIGHT),
        layout="constrained",
    )
    axis.set_yscale("log")
    largest = _range([mark for marks in families.values() for mark in marks])
    for column, marks in enumerate(families.values()):
        _draw_family(axis, column, marks, largest)
        axis.axvline(
            column + 1,
            color="0.85",
            linewidth=0.8,
            zorder=0,
        )
    axis.axhspan(
        1 / 1.1,
        1.1,
        color="0.93",
        zorder=0,
        label="10 %",
    )
    axis.axhline(
        1.0,
        color="0.3",
        linewidth=0.8,
        zorder=1,
    )
    axis.set_xlim(0, len(families))
    middles = np.arange(len(families)) + 0.5
    axis.set_xticks(middles, list(families), parse_math=False)
    axis.tick_params(axis="x", length=0)
    axis.set_ylim(1 / largest, largest)
    shown = [tick for tick in TICKS if 1 / largest <= tick <= largest]
    axis.set_yticks(shown, [f"{tick:g}" for tick in shown])
    axis.minorticks_off()
    axis.set_ylabel("predicted over measured")
    _legend(axis)
    path.parent.mkdir(parents=True, exist_ok=True)
    drawing.savefig(path, dpi=110)
    pyplot.close(drawing)


def _range(marks: Sequence[Mark]) -> float:
    """The ratio at the upper edge; its inverse is at the lower one."""
    ratios = [mark.ratio for mark in marks if 0 < mark.ratio < math.inf]
    needed = max([LEAST_RANGE, *(1.1 * max(ratio, 1 / ratio) for ratio in ratios)])
    return min(needed, LARGEST_RANGE)


def _draw_family(axis, column: int, marks: Sequence[Mark], largest: float) -> None:
    """The marks of a family, evenly spaced over its column."""
    places = column + (np.arange(len(marks)) + 0.5) / len(marks)
    for x, mark in zip(places, marks, strict=True):
        colour = NOT_ASKED
        if is_asked(mark.comparison.measured):
            colour = AS_ASKED if is_right(mark.comparison) else MISSED
        # The values of a curve through zero have no meaningful ratios.
        if not math.isfinite(mark.comparison.measured.reference):
            limits = np.clip([mark.ratios.min(), mark.ratios.max()], 1 / largest, largest)
            axis.plot(
                [x, x],
                limits,
                color=colour,
                linewidth=0.8,
                alpha=0.5,
                zorder=2,
            )
        if math.isfinite(mark.comparison.measured.peer_error):
            axis.plot(x, mark.peer_ratio, **PEER)
        # What failed, or is of the other sign, has no place on the axis: it is at its lower edge.
        shown = min(max(mark.ratio, 1 / largest), largest)
        axis.plot(
            x,
            shown,
            "o",
            color=colour,
            markersize=4,
            zorder=3,
            clip_on=False,
        )
        if shown != mark.ratio:
            words = f"{mark.ratio:.2g}" if math.isfinite(mark.ratio) else "failed"
            axis.annotate(words, (x, shown), fontsize=7, ha="center", va="bottom")


def _legend(axis) -> None:
    """What the marks mean."""
    kinds = {
        "error as asked": AS_ASKED,
        "error larger than asked": MISSED,
        "for information": NOT_ASKED,
    }
    for words, colour in kinds.items():
        axis.plot([], [], "o", color=colour, markersize=4, label=words)
    axis.plot([], [], label="peer", **PEER)
    axis.legend(
        fontsize=8,
        ncols=5,
        loc="upper center",
        bbox_to_anchor=(0.5, 1.12),
        frameon=False,
    )
