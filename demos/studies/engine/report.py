"""What a study found: a markdown table, a picture of error against run time and h, and what falls
short."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from demos.studies.engine.study import Measure, Result, Study


def curves(study: Study, results: list[Result]) -> dict[tuple[Any, ...], list[Result]]:
    """The results that differ in the refined (last) axis only, by the values of the others."""
    *others, _ = study.axes
    found: dict[tuple[Any, ...], list[Result]] = {}
    for result in results:
        found.setdefault(tuple(result.case[name] for name in others), []).append(result)
    return found


# By so much an observed order may be below the expected one: coarse cases are not yet in the
# asymptotic range.
ORDER_MARGIN = 0.3


def order(study: Study, measure: Measure, coarse: Result, fine: Result) -> float:
    """Observed order between two results of a curve; not a number where there is none."""
    h0 = study.size(coarse.case)
    h1 = study.size(fine.case)
    e0 = _error(measure, coarse)
    e1 = _error(measure, fine)
    if not (e0 > 0 and e1 > 0 and h0 != h1):
        return math.nan
    return math.log(e0 / e1) / math.log(h0 / h1)


def table(study: Study, results: list[Result]) -> str:
    """All results of a study as a Markdown table, curve by curve, with errors and orders."""
    head = [*study.axes]
    for measure in study.measures:
        head += [measure.name, "error", "order"]
    head += study.columns
    lines = [
        f"### {study.title}",
        "",
        "| " + " | ".join(head) + " |",
        "|---" * len(head) + "|",
    ]
    for curve in curves(study, results).values():
        for previous, result in zip([None, *curve], curve, strict=False):
            cells = [str(value) for value in result.case.values()]
            for measure in study.measures:
                # The coarsest case of a curve has none to be compared with.
                observed = ""
                if previous:
                    slope = order(study, measure, previous, result)
                    observed = "" if math.isnan(slope) else f"{slope:.1f}"
                value = result.values.get(measure.name, math.nan)
                error = _error(measure, result)
                cells += [_number(value, 6), _number(error, 2), observed]
            cells += [_number(result.values.get(name, math.nan), 4) for name in study.columns]
            if result.failed:
                cells[-1] += " (failed)"
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def summary(studies: list[tuple[Study, list[Result]]]) -> str:
    """Markdown: of every study, measure and element, what the finest cases leave at worst, and
    orders if expected."""
    lines = [
        "| study | measure | element | largest error | order | CPU time [s] |",
        "|---" * 6 + "|",
    ]
    for study, results in studies:
        groups: dict[str, list[list[Result]]] = {}
        for name, curve in curves(study, results).items():
            done = [result for result in curve if not result.failed]
            element = next((one for one in ("P2", "P1") if one in name), "")
            if done:
                groups.setdefault(element, []).append(done)
        for measure in study.measures:
            for element, found in groups.items():
                finest = [curve[-1] for curve in found]
                orders = []
                for curve in found:
                    # An infinite rate means that no order is expected.
                    has_order = math.isfinite(measure.rate(curve[-1].case))
                    if has_order and len(curve) > 1:
                        orders.append(order(study, measure, curve[0], curve[-1]))
                largest_error = max(_error(measure, r) for r in finest)
                seconds = [r.values["seconds"] for r in finest]
                cells = [
                    study.name,
                    measure.name,
                    element,
                    _number(largest_error, 2),
                    _span(orders, 1, "f"),
                    _span(seconds, 2, "g"),
                ]
                lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _span(values: list[float], digits: int, kind: str) -> str:
    """Smallest and largest of some numbers."""
    if not values:
        return ""
    # One number if both are the same to these digits.
    ends = {f"{value:.{digits}{kind}}" for value in (min(values), max(values))}
    return " to ".join(sorted(ends, key=float))


def shortfalls(study: Study, results: list[Result]) -> list[str]:
    """What is not as the study declares: failures, errors beyond the tolerance, orders below the
    expected rate."""
    found = [
        f"{_words(result.case)}: {result.failed}"
        for result in results
        if result.failed and not study.may_fail
    ]
    for curve in curves(study, results).values():
        done = [result for result in curve if not result.failed]
        for measure in study.measures if done else ():
            error = _error(measure, done[-1])
            # Written so that an error that is not a number falls short, too.
            if not error <= measure.tolerance:
                found.append(
                    f"{measure.name}, {_words(done[-1].case)}: error {error:.2g} > "
                    f"{measure.tolerance:.2g}"
                )
            rate = measure.rate(done[-1].case)
            if math.isfinite(rate) and len(done) > 1:
                overall = order(study, measure, done[0], done[-1])
                if not overall >= rate - ORDER_MARGIN:
                    found.append(
                        f"{measure.name}, {_words(done[-1].case)}: order {overall:.2f}, expected "
                        f"{rate:.2g}"
                    )
    return found


def picture(study: Study, results: list[Result], path: Path) -> None:
    """Error against run time and against h, one row of panels for each measure; P2 is dashed."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from matplotlib.ticker import NullFormatter

    rows = len(study.measures)
    found = curves(study, results)
    # In inches; the legend has a line for each curve.
    size = (11, rows * max(3.3, 0.165 * len(found)) + 0.4)
    figure, panels = pyplot.subplots(
        rows,
        2,
        figsize=size,
        squeeze=False,
        sharey="row",
        sharex="col",
        layout="constrained",
    )
    colours = _colours(found)
    sizes = sorted({study.size(r.case) for r in results})
    for measure, (left, right) in zip(study.measures, panels, strict=True):
        for name, curve in found.items():
            done = [r for r in curve if not r.failed]
            errors = [_error(measure, r) for r in done]
            label = ", ".join(map(str, name)) or study.name
            if len(done) > 1:
                overall = order(study, measure, done[0], done[-1])
                if not math.isnan(overall):
                    label += f" (order {overall:.1f})"
            style = {"marker": "o", "markersize": 4, "color": colours[name], "label": label}
            if "P2" in name:
                style |= {"linestyle": "--", "markerfacecolor": "white"}
            left.loglog(
                [r.values["seconds"] for r in done],
                errors,
                **style,
            )
            right.loglog(
                [study.size(r.case) for r in done],
                errors,
                **style,
            )
        left.set_ylabel(f"relative error of {measure.name}")
        for panel in (left, right):
            panel.grid(True, which="both", alpha=0.25)
        # On a short logarithmic axis the default ticks are few.
        if sizes[-1] < 20 * sizes[0]:
            right.set_xticks(sizes, [f"{h:.2g}" for h in sizes])
            right.xaxis.set_minor_formatter(NullFormatter())
        right.legend(
            fontsize=7,
            loc="center left",
            bbox_to_anchor=(1.0, 0.5),
            frameon=False,
        )
    panels[-1, 0].set_xlabel("CPU time without compilation [s]")
    panels[-1, 1].set_xlabel("h")
    figure.suptitle(study.title)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def _colours(found: Iterable[tuple[Any, ...]]) -> dict[tuple[Any, ...], Any]:
    """A colour for each curve; those that differ in the element only share theirs."""
    from matplotlib import colormaps

    alike = {name: tuple(value for value in name if value not in ("P1", "P2")) for name in found}
    groups = list(dict.fromkeys(alike.values()))
    palette = colormaps["tab10" if len(groups) <= 10 else "tab20"].colors  # type: ignore[attr-defined]
    return {name: palette[groups.index(group) % len(palette)] for name, group in alike.items()}


def _error(measure: Measure, result: Result) -> float:
    if measure.name not in result.values:
        return math.nan
    return measure.error(result.case, result.values[measure.name])


def _words(case: dict[str, Any]) -> str:
    return ", ".join(f"{name} {value}" for name, value in case.items())


def _number(value: float, digits: int) -> str:
    if math.isnan(value):
        return ""
    return f"{value:.{digits}g}"
