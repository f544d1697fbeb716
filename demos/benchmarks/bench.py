"""Problems as sets of cases of `gossamer_fx.analysis.cases`: contestants take turns, medians are
shown, and results are compared with what a problem declares."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from contestants import HERE, PACKAGES, SELF, Failed, run
from mpi4py import MPI
from problems import ERROR_PROBLEMS, ErrorProblem, Figures, Problem, Words

from gossamer_fx.extend import (
    CaseSet,
    ErrorCurve,
    Judgement,
    Result,
    draw_error_curves,
    markdown_table,
    read_results,
    run_cases,
    write_results,
)

STORED = HERE / "results"
PAGE = HERE.parent.parent / "docs" / "benchmark.md"
DIGITS = 4  # of stored numbers

# Name of the program of the case that computes the answer of an error problem.
ANSWER = "answer"
# Values of a case that are not words of a script.
OF_THE_CASE = ("case", "program", "run")


def package_of(program: str) -> str:
    """The program of a contestant, which may come in several ways: "kratos, no wrinkling"."""
    name = program.split(",")[0]
    return name if name in PACKAGES else SELF


def words_of(values: Mapping[str, Any]) -> Words:
    """The words of a script among the values of a case."""
    return {name: value for name, value in values.items() if name not in OF_THE_CASE}


def solved(script: str, values: Mapping[str, Any], seconds: float) -> Figures:
    """Let the contestant of a case solve it."""
    return run(script, package_of(values["program"]), words_of(values), seconds)


def medians(results: list[Result], *names: str) -> dict[tuple[Any, ...], Figures]:
    """Medians of the figures over the runs that did not fail, by other values of the cases.

    They are of each figure by itself, so that they may come from different runs.
    """
    groups: dict[tuple[Any, ...], list[Result]] = {}
    for result in results:
        if not result.failed:
            key = tuple(result.values[name] for name in names)
            groups.setdefault(key, []).append(result)
    return {
        key: {
            name: median(r.numbers[name] for r in found)
            for name, number in found[0].numbers.items()
            if not isinstance(number, list)
        }
        for key, found in groups.items()
    }


# ---- run times -----------------------------------------------------------------------------------


def turns(name: str, problem: Problem, runs: int, quick: bool) -> CaseSet:
    """The cases of a problem.  Contestants take turns, so that a load on the machine meets all."""
    sizes = problem.quick if quick else problem.cases

    def outcome(comm: MPI.Intracomm, folder: Path, **values: Any) -> Figures:
        figures = solved(problem.script or name, values, problem.seconds)
        return figures | {"cost": problem.cost_of(figures)}

    def judge(results: list[Result]) -> Iterator[Judgement]:
        yield from _own_failures(results)
        for peer, ratio in ratios(problem, results).items():
            yield Judgement(f"no ratio to {peer}: it failed", math.isfinite(ratio))
        found = medians(results, "case", "program")
        for (label, program), figures in found.items():
            own = found.get((label, SELF), figures)
            for figure, largest in problem.equal.items():
                if program != SELF:
                    apart = abs(figures[figure] / own[figure] - 1)
                    words = f"{label}, {program}: {figure} differs by {apart:.1e} > {largest:.0e}"
                    yield Judgement(words, apart <= largest)
            if package_of(program) == SELF:
                answers = {**problem.answers.get("all", {}), **problem.answers.get(label, {})}
                for figure, (answer, largest) in answers.items():
                    error = abs(figures[figure] - answer) / (abs(answer) or 1.0)
                    words = f"{label}, {program}: {figure} {figures[figure]:.6g}, answer "
                    words += f"{answer:.6g}, off by {error:.1e} > {largest:.0e}"
                    yield Judgement(words, error <= largest)
            for figure, largest in problem.limits.items():
                if package_of(program) == SELF:
                    value = figures[figure]
                    words = f"{label}, {program}: {figure} {value:.1e} > {largest:.0e}"
                    yield Judgement(words, value <= largest)

    return CaseSet(
        name=name,
        title=problem.title,
        outcome=outcome,
        cases=[
            {"case": label, "program": program, "run": number, **words}
            for label, contestants in sizes.items()
            for number in range(runs)
            for program, words in contestants.items()
        ],
        rows=lambda results: _cost_rows(problem, results),
        judge=judge,
        draw=(lambda results, path: draw_costs(problem, results, path)) if problem.chart else None,
        shows=("cost",),
        expected_warnings=problem.expected_warnings,
        may_fail=True,
        failures=(Failed,),
    )


def _own_failures(results: list[Result]) -> Iterator[Judgement]:
    """Of this program; a peer may fail, as long as another case has its ratio."""
    for result in results:
        if package_of(result.values["program"]) == SELF:
            yield Judgement(f"{result.values}: {result.failed}", not result.failed)


def ratios(problem: Problem, results: list[Result]) -> dict[str, float]:
    """Cost of each peer over that of this program; NaN if it failed in all cases.

    The smallest of all cases is the one that flatters this program least.
    """
    found = medians(results, "case", "program")
    smallest = {}
    for peer in problem.peers:
        of_cases = [
            figures["cost"] / found[label, SELF]["cost"]
            for (label, program), figures in found.items()
            if program == peer and (label, SELF) in found
        ]
        smallest[peer] = min(of_cases, default=math.nan)
    return smallest


def _cost_rows(problem: Problem, results: list[Result]) -> Iterator[list[str]]:
    """Medians of all figures, size by size and program by program."""
    found = medians(results, "case", "program")
    names = list(dict.fromkeys(name for figures in found.values() for name in figures))
    names.remove("cost")
    yield ["case", "program", problem.unit, *names]
    for (label, program), figures in found.items():
        cells = [f"{figures[name]:.4g}" if name in figures else "" for name in ["cost", *names]]
        yield [label, program, *cells]


def draw_costs(problem: Problem, results: list[Result], path: Path) -> None:
    """Draw cost and memory over the unknowns, and print their exponents."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = list(medians(results, "case", "program").values())
    if len(rows) < 2:
        return
    dofs = np.array([row["dofs"] for row in rows])
    cost = np.array([row["cost"] for row in rows])
    memory = np.array([row["MB"] for row in rows])
    newton = np.array([row["Newton/step"] for row in rows])
    figure = Figure(figsize=(9, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for axes, values, label in (
        (left, cost, "step"),
        (left, cost / newton, "Newton iteration"),
        (right, memory, "process"),
    ):
        # Slope of the straight line in double logarithmic axes.
        exponent = np.polyfit(np.log(dofs), np.log(values), 1)[0]
        axes.loglog(dofs, values, "o-", label=f"{label}, exponent {exponent:.2f}")
        print(f"exponent of a {label}: {exponent:.3f}")
    bytes_per_unknown = (memory[-1] - memory[0]) * 2**20 / (dofs[-1] - dofs[0])
    print(f"memory: {bytes_per_unknown:.0f} bytes per unknown")
    for axes, label in ((left, problem.unit), (right, "memory [MB]")):
        axes.set(xlabel="unknowns", ylabel=label)
        axes.grid(which="both", alpha=0.3)
        axes.legend()
    FigureCanvasAgg(figure).print_png(str(path))


# ---- errors against run time ---------------------------------------------------------------------


def error_cases(name: str, problem: ErrorProblem, runs: int, quick: bool) -> CaseSet:
    """The points of all curves of a problem, and the answer if it is computed."""
    curves = problem.quick if quick else problem.curves
    answer = problem.quick_answer if quick else problem.answer
    cases: list[dict[str, Any]] = []
    if answer is not None:
        cases.append({"program": ANSWER, "run": 0, **answer})
    for number in range(runs):
        for program, points in curves.items():
            cases += [{"program": program, "run": number, **words} for words in points]

    def judge(results: list[Result]) -> Iterator[Judgement]:
        yield from _own_failures(results)
        yield from judge_points(problem, points_of(problem, results), quick)

    return CaseSet(
        name=name,
        title=problem.title,
        outcome=lambda comm, folder, **values: solved(problem.script, values, problem.seconds),
        cases=cases,
        rows=lambda results: point_rows(problem, points_of(problem, results)),
        judge=judge,
        draw=lambda results, path: draw_points(problem, points_of(problem, results), path),
        expected_warnings=problem.expected_warnings,
        may_fail=True,
        failures=(Failed,),
    )


def points_of(problem: ErrorProblem, results: list[Result]) -> list[Result]:
    """One result for each point: error, unknowns, and the median of the CPU time of its runs.

    A program that goes on after a step without convergence, or lets films pass through each other,
    may be fast: such counts stay, too.
    """
    [answer, *_] = [
        *(result.numbers for result in results if result.values["program"] == ANSWER),
        {},
    ]
    groups: dict[str, list[Result]] = {}
    for result in results:
        if result.values["program"] != ANSWER:
            key = repr((result.values["program"], words_of(result.values)))
            groups.setdefault(key, []).append(result)
    points = []
    for found in groups.values():
        first = found[0]
        values = {name: value for name, value in first.values.items() if name != "run"}
        failed = next((one.failed for one in found if one.failed), "")
        numbers: dict[str, float] = {}
        if not failed:
            # Errors are the same in every run; times are not.
            numbers["cpu"] = _rounded(median(one.numbers["cpu"] for one in found))
            numbers["error"] = _rounded(problem.error_of(first.numbers, answer))
            numbers["unknowns"] = first.numbers["dofs"]
            numbers["runs"] = len(found)
            for name in ("unconverged", "penetrations"):
                if name in first.numbers:
                    numbers[name] = first.numbers[name]
        seconds = sum(one.seconds for one in found)
        warnings = [text for one in found for text in one.warnings]
        points.append(Result(values, numbers, round(seconds, 1), failed, warnings))
    return points


def judge_points(problem: ErrorProblem, points: list[Result], quick: bool) -> Iterator[Judgement]:
    """Compare the last point of each curve of this program with the error that it declares."""
    largest = problem.quick_accepted if quick else problem.accepted
    finest = {point.values["program"]: point for point in points if not point.failed}
    for program, point in finest.items():
        if package_of(program) == SELF:
            error = point.numbers["error"]
            words = f"{program}: {problem.measure} {error:.2g} > {largest:.2g}"
            yield Judgement(words, error <= largest)


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _as_text(words: Words) -> str:
    return " ".join(f"{k}={v:g}" for k, v in words.items() if isinstance(v, int | float))


def draw_points(problem: ErrorProblem, points: list[Result], path: Path) -> None:
    """Draw error over CPU time, one curve a program; variants of a program have its colour."""
    curves = []
    for program in dict.fromkeys(point.values["program"] for point in points):
        found = [p for p in points if p.values["program"] == program and not p.failed]
        curves.append(
            ErrorCurve(
                name=program,
                seconds=[point.numbers["cpu"] for point in found],
                errors=[point.numbers["error"] for point in found],
                colour_group=program.split(",")[0],
            )
        )
    draw_error_curves(path, {problem.measure: curves}, problem.title)


def point_rows(problem: ErrorProblem, points: list[Result]) -> Iterator[list[str]]:
    """The points of a problem as cells of a table."""
    yield ["program", "case", "unknowns", problem.measure, "CPU time [s]", "remark"]
    for point in points:
        cells = [point.values["program"], _as_text(words_of(point.values))]
        if point.failed:
            yield [*cells, "", "", "", "failed"]
            continue
        numbers = point.numbers
        remarks = []
        if numbers.get("unconverged"):
            steps = point.values["steps"]
            remarks.append(f"{numbers['unconverged']:.0f} of {steps} steps unconverged")
        if numbers.get("penetrations"):
            count = numbers["penetrations"]
            remarks.append(f"{count:.0f} edges intersect the films at the end")
        cells += [f"{numbers['unknowns']:.0f}", f"{numbers['error']:.2g}"]
        yield [*cells, f"{numbers['cpu']:.3g}", "; ".join(remarks)]


def solve_errors(name: str, runs: int, quick: bool, folder: Path, store: bool) -> list[Judgement]:
    """Solve an error problem; with `store` its points are those that the page shows."""
    problem = ERROR_PROBLEMS[name]
    cases = error_cases(name, problem, runs, quick)
    results = run_cases(cases, MPI.COMM_SELF, folder / name, fresh=True)
    if store:
        points = points_of(problem, results)
        write_results(STORED / f"{name}.json", name, points)
        draw_points(problem, points, STORED / f"{name}.png")
    return cases.judgements(results)


def page_part() -> str:
    """The part of the page that is made from the stored results."""
    parts = []
    for name, problem in ERROR_PROBLEMS.items():
        points = read_results(STORED / f"{name}.json", name)
        # Problems can be stored one by one.
        if not points:
            continue
        count = max(point.numbers.get("runs", 1) for point in points)
        runs = "one run" if count == 1 else f"the median of {count:.0f} runs"
        picture = f"![{problem.measure} over CPU time](../demos/benchmarks/results/{name}.png)"
        parts += [
            f"## {problem.title}",
            f"{problem.reference} Each point is {runs} of `./gossamer bench {name} --store`.",
            picture,
        ]
    return "\n" + "\n\n".join(parts) + "\n\n"


def tables_of_points() -> str:
    """All stored points as tables, which the site has on a separate page."""
    parts = []
    for name, problem in ERROR_PROBLEMS.items():
        points = read_results(STORED / f"{name}.json", name)
        if points:
            numbers = markdown_table(point_rows(problem, points)).strip()
            parts.append(f"## {problem.title}\n\n{numbers}\n")
    return "\n".join(parts)
