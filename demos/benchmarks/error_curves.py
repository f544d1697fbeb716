"""Error against CPU time: solve problems on several meshes or steps, store, draw, and write the
page docs/benchmark.md.

A point is the median of some runs of one contestant in one case.  Results are JSON files, one a
problem; the page shows those that are stored in demos/benchmarks/results.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from statistics import median
from typing import Any

from contestants import HERE, PACKAGES, SELF, Failed, run
from error_problems import ERROR_PROBLEMS, ErrorProblem
from problems import Figures, Words

from gossamer_fx.version import VERSION

STORED = HERE / "results"
PAGE = HERE.parent.parent / "docs" / "benchmark.md"
# The part of the page that is written by this command.
BETWEEN = re.compile(r"(?<=<!-- benchmark -->\n).*?(?=<!-- /benchmark -->)", re.DOTALL)
FORMAT = 1
DIGITS = 4  # of stored numbers
COLOURS = {
    "gossamer": "tab:red",
    "kratos": "tab:blue",
    "exudyn": "tab:green",
    "newton": "tab:purple",
    "ngsolve": "tab:brown",
}
# Of the variants of one program.
LINES = ("o-", "s--", "^:")

Stored = dict[str, Any]


def solve(name: str, runs: int, quick: bool, folder: Path) -> Stored:
    """Solve a problem with all its programs; print, store and draw the results.

    Args:
        name: of the problem.
        runs: of each point, of which the median of the CPU time is taken.
        quick: whether to solve the quick form.
        folder: of the results.
    """
    problem = ERROR_PROBLEMS[name]
    print(problem.title, flush=True)
    answer: Figures = {}
    if problem.answer is not None:
        # The quick form only shows that everything runs: its finest case stands for the answer.
        words = next(iter(problem.quick.values()))[-1] if quick else problem.answer
        answer = run(problem.script, SELF, words, problem.seconds)
    points = [
        solve_point(problem, program, words, runs, answer)
        for program, cases in (problem.quick if quick else problem.curves).items()
        for words in cases
    ]
    stored: Stored = {
        "format": FORMAT,
        "problem": name,
        "version": VERSION,
        "runs": runs,
        "points": points,
    }
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(stored, indent=1, ensure_ascii=False) + "\n"
    (folder / f"{name}.json").write_text(text, encoding="utf-8")
    draw(problem, points, folder / f"{name}.png")
    return stored


def solve_point(
    problem: ErrorProblem, program: str, words: Words, runs: int, answer: Figures
) -> Stored:
    """Error, CPU time and unknowns of one program in one case, or its failure."""
    script_of = program.split(",")[0]
    package = script_of if script_of in PACKAGES else SELF
    point: Stored = {"program": program, "words": words}
    try:
        found = [run(problem.script, package, words, problem.seconds) for _ in range(runs)]
    except Failed as failure:
        print(f"{program:26} {_as_text(words):40} failed: {failure}", flush=True)
        return point | {"failure": str(failure)}
    # Errors are the same in every run; times are not.
    figures = found[-1]
    point["cpu"] = _rounded(median(one["cpu"] for one in found))
    point["error"] = _rounded(problem.error(figures, answer))
    point["unknowns"] = int(figures["dofs"])
    # A program that goes on after a step without convergence, or lets films pass through each
    # other, may be fast.
    for key in ("unconverged", "penetrations"):
        if key in figures:
            point[key] = int(figures[key])
    print(
        f"{program:26} {_as_text(words):40} {point['cpu']:10.4g} s   error {point['error']:.2g}",
        flush=True,
    )
    return point


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _as_text(words: Words) -> str:
    return " ".join(f"{key}={value:g}" for key, value in words.items() if _is_number(value))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float)


def draw(problem: ErrorProblem, points: list[Stored], path: Path) -> None:
    """Draw error over CPU time, both logarithmic, one curve a program."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    # As wide as the text of the site.
    figure = Figure(figsize=(7.0, 4.2), dpi=100, facecolor="white", layout="constrained")
    axes = figure.subplots()
    variants: dict[str, int] = {}
    # Programs in the order in which they were solved, each once.
    for program in dict.fromkeys(point["program"] for point in points):
        curve = [p for p in points if p["program"] == program and "failure" not in p]
        # Variants of a program have its colour and another line.
        name = program.split(",")[0]
        line = LINES[variants.get(name, 0)]
        variants[name] = variants.get(name, 0) + 1
        cpu = [point["cpu"] for point in curve]
        error = [point["error"] for point in curve]
        axes.loglog(cpu, error, line, color=COLOURS[name], label=program)
    axes.set(xlabel="CPU time [s]", ylabel=problem.measure, title=problem.title)
    axes.grid(which="major", alpha=0.3)
    axes.legend(fontsize=9)
    FigureCanvasAgg(figure).print_png(str(path))


def table(problem: ErrorProblem, stored: Stored) -> str:
    """The points of a problem as a Markdown table."""
    lines = [
        f"| program | case | unknowns | {problem.measure} | CPU time [s] | remark |",
        "|---|---|---|---|---|---|",
    ]
    for point in stored["points"]:
        cells = [point["program"], _as_text(point["words"])]
        if "failure" in point:
            cells += ["", "", "", "failed"]
        else:
            cells += [
                str(point["unknowns"]),
                f"{point['error']:.2g}",
                f"{point['cpu']:.3g}",
                _remark(point),
            ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _remark(point: Stored) -> str:
    """What a time and an error alone would hide."""
    remarks = []
    if point.get("unconverged"):
        remarks.append(f"{point['unconverged']} of {point['words']['steps']} steps unconverged")
    if point.get("penetrations"):
        remarks.append(f"{point['penetrations']} edges intersect the films at the end")
    return "; ".join(remarks)


def page_part() -> str:
    """The part of the page that is made from the stored results."""
    parts = []
    for name, problem in ERROR_PROBLEMS.items():
        path = STORED / f"{name}.json"
        # Problems can be stored one by one.
        if not path.is_file():
            continue
        stored = json.loads(path.read_text(encoding="utf-8"))
        runs = "one run" if stored["runs"] == 1 else f"median of {stored['runs']} runs"
        picture = (
            f"![{problem.title}: {problem.measure} over CPU "
            f"time](../demos/benchmarks/results/{name}.png)"
        )
        parts += [
            f"## {problem.title}",
            f"Answer: {problem.reference} Made by `./gossamer bench {name} --store`, {runs}.",
            picture,
            # Folded on the site, where the picture is enough at first.
            f":::{{dropdown}} Numbers\n{table(problem, stored).strip()}\n:::",
        ]
    return "\n" + "\n\n".join(parts) + "\n\n"


def write_page() -> None:
    """Write the stored results into the page."""
    text = PAGE.read_text(encoding="utf-8")
    part = page_part()
    PAGE.write_text(BETWEEN.sub(lambda _: part, text), encoding="utf-8")
