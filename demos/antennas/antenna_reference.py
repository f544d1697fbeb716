"""Displacement of the tip of the swinging antenna, next to models of its film as a shell elsewhere.

The paper compares its membrane, on 2 × 2, 3 × 3 and 4 × 4 elements with 4, 6 and 8 elements a boom
(its Figs. 5 to 7), with a commercial code, in which the film is a thin shell that does not wrinkle.
Here are the same three meshes of the demo `antenna_pendulum`, the rigid limit, and instead of the
commercial code the shell as this program has it, `Plate` with the law `Linear`, and as NGSolve has
it: other code, without wrinkling, with bending, with booms that stay straight.

By hand, a boom of length l = 2.97 m, bending stiffness EI = 1210 N m² and m = 0.097 kg/m that is
hinged at its ends sags by 5 m g l⁴/(384 EI) = 0.08 mm, and its first free frequency is
22.4/(2π l²) √(EI/m) = 45 Hz.  So the booms are stiff on the scale of millimetres, and what deviates
from the rigid limit is the film: it carries the transverse boom, and sags.

    ./gossamer demo antenna_reference

draws the displacements and their deviations from the rigid limit.  Runs that are in the file of
results are not made again; the peers are installed from PyPI at their first use.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.antennas.antenna_attitude import SIDE
from demos.antennas.antenna_pendulum import build, rigid_angle
from demos.benchmarks.contestants import run as run_peer
from demos.common.figures import BLUE, GREEN, GREY, RED, finish, new_figure, save
from gossamer_fx.extend import Array, Result, markdown_table, read_results, write_results

NAME = "antenna_reference"
STORED = Path(__file__).parent / f"{NAME}.json"
SELF = "gossamer_fx"
# Figures of the paper: cells of a side and elements of a boom.
FIGURES = {
    5: (2, 4),
    6: (3, 6),
    7: (4, 8),
}
# The shell that the pictures show, of each program.
SHELL = {"cells": 6, "elements": 12, "dt": 0.01, "shell": True}
# Meshes of this program's shell at one step, the finest last.
SERIES: Sequence[Mapping[str, Any]] = tuple(
    {"cells": n, "elements": 2 * n, "dt": 0.0025, "shell": True} for n in (3, 6, 9, 12)
)
FINEST = SERIES[-1]
# As many elements as the paper's commercial code has, but for a node at the thirds of a boom.
FINE_BOOMS = {**SHELL, "elements": 198}
SHORTER_STEP = {**SHELL, "dt": 0.005}
# Booms as straight as those of NGSolve's model.
STIFF = {**SHELL, "stiffer": 100.0}
# The same discretisation of the film in both programs, on two meshes; and strains of other points.
COARSE = {"n": 3, "tied": 1, "dt": 0.01}
REFERENCE = {"n": 6, "tied": 1, "dt": 0.01}
SAMPLED = {"n": 6, "tied": 0, "dt": 0.01}
# Every run by its program and the words of its model.
RUNS: Sequence[tuple[str, Mapping[str, Any]]] = (
    *((SELF, {"cells": n, "elements": m, "dt": 0.01, "order": 2}) for n, m in FIGURES.values()),
    (SELF, {"cells": 6, "elements": 12, "dt": 0.01, "order": 2}),
    (SELF, {"cells": 3, "elements": 6, "dt": 0.01, "shell": True}),
    (SELF, SHELL),
    (SELF, STIFF),
    (SELF, FINE_BOOMS),
    (SELF, SHORTER_STEP),
    *((SELF, words) for words in SERIES),
    ("ngsolve", COARSE),
    ("ngsolve", REFERENCE),
    ("ngsolve", {"n": 3, "tied": 0, "dt": 0.01}),
    ("ngsolve", SAMPLED),
    *(("exudyn", {"n": n, "elements": n, "dt": 0.005}) for n in (3, 6)),
)
UNTIL = 2.0  # s
# Interval of stored heights [s], and the time after which a peer has failed [s].
EVERY = 0.02
INSTANTS = EVERY * np.arange(round(UNTIL / EVERY) + 1)
PEER_SECONDS = 7200.0


def own_run(until: float = UNTIL, **words: Any) -> dict[str, Any]:
    """Vertical displacement of the tip over the time [m] in this program, its CPU time [s] and
    unknowns."""
    case = build(MPI.COMM_SELF, until=until, **words)
    series = gx.Series(case.probes)
    simulation = case.simulation([series])
    cpu = time.process_time()
    simulation.run(until=until)
    return {
        "time": series.time,
        "tip": series["tip [m]"],
        "cpu": time.process_time() - cpu,
        "dofs": simulation.system.unknowns.numbering.size,
    }


def peer_run(program: str, until: float = UNTIL, **words: Any) -> dict[str, Any]:
    """The same in a peer, by its script for the benchmark `pendulum`."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "heights.json"
        run_peer("pendulum", program, {**words, "until": until, "output": output}, PEER_SECONDS)
        found = json.loads(output.read_text(encoding="utf-8"))
    return {name: found[name] for name in ("time", "tip", "cpu", "dofs")}


def computed(program: str, words: Mapping[str, Any]) -> Result:
    """One of the runs, at the stored instants, to a micrometre."""
    start = time.perf_counter()
    found = own_run(**words) if program == SELF else peer_run(program, **words)
    numbers = {
        "cpu": round(found["cpu"], 1),
        "dofs": found["dofs"],
        "tip": np.interp(INSTANTS, found["time"], found["tip"]).round(6).tolist(),
    }
    return Result({"program": program, **words}, numbers, round(time.perf_counter() - start, 1))


def all_results(path: Path = STORED) -> list[Result]:
    """The results of all runs: those of the file, and those that it does not have, which are added
    to it."""
    known = {json.dumps(one.values): one for one in read_results(path, NAME)}
    results = []
    for program, words in RUNS:
        key = json.dumps({"program": program, **words})
        if key not in known:
            known[key] = computed(program, words)
            write_results(path, NAME, list(known.values()))
        results.append(known[key])
    return results


def tip(results: Sequence[Result], program: str, words: Mapping[str, Any]) -> Array:
    """Displacements [m] of the tip of one of the runs, at the stored instants."""
    wanted = {"program": program, **words}
    return np.array(next(one for one in results if one.values == wanted).numbers["tip"])


def differences(one: Array, other: Array) -> tuple[float, float, float]:
    """Distance of two displacements [mm] at 1 s, at 2 s, and the largest of all instants."""
    apart = 1e3 * np.abs(one - other)
    return float(apart[round(1 / EVERY)]), float(apart[-1]), float(apart.max())


def draw(results: Sequence[Result], path: Path) -> None:
    """One column for each figure of the paper: displacements of the tip, and their deviations from
    the rigid limit."""
    rigid = -SIDE * 2**0.5 * np.sin(rigid_angle(INSTANTS))
    figure = new_figure(12.0, 7.0)
    axes = figure.subplots(2, 3, sharex=True, sharey="row")
    for column, (number, (cells, elements)) in enumerate(FIGURES.items()):
        words = {"cells": cells, "elements": elements, "dt": 0.01, "order": 2}
        label = f"membrane {cells}×{cells}-{elements}"
        curves = (
            ("rigid", rigid, {"color": GREY, "lw": 3.0, "alpha": 0.6}),
            (label, tip(results, SELF, words), {"color": BLUE}),
            ("shell 6×6-12", tip(results, SELF, SHELL), {"color": GREEN}),
            ("shell 6×6, NGSolve", tip(results, "ngsolve", REFERENCE), {"color": RED, "ls": "--"}),
        )
        for name, heights, style in curves:
            axes[0, column].plot(INSTANTS, heights, label=name, **style)
            axes[1, column].plot(INSTANTS, 1e3 * (heights - rigid), label=name, **style)
        axes[0, column].set_title(f"as Fig. {number} of the paper", fontsize=10)
        finish(axes[0, column], "", "displacement of the tip [m]" if column == 0 else "")
        axes[1, column].set_xlabel("time [s]")
        axes[1, column].grid(alpha=0.3)
    axes[1, 0].set_ylabel("deviation from the rigid limit [mm]")
    save(figure, path)


def model_text(values: Mapping[str, Any]) -> str:
    """One of the runs in words."""
    if values["program"] == "exudyn":
        return f"shell in Exudyn, {values['n']}×{values['n']}-{values['elements']}"
    if values["program"] == "ngsolve":
        strain = "the same strains" if values["tied"] else "strains of three points"
        return f"shell in NGSolve, {values['n']}×{values['n']}, {strain}"
    film = "shell" if values.get("shell") else "membrane"
    cells = f"{values['cells']}×{values['cells']}-{values['elements']}"
    booms = ", stiff booms" if "stiffer" in values else ""
    return f"{film} {cells}, h = {values['dt']:g} s{booms}"


def figures(path: Path = STORED) -> list[Result]:
    """What the pages say of the stored runs.

    Returns:
        for each run its displacements and its distances from the finest shell of this program
        [mm], unknowns and CPU time [s]; for each pair of runs, named in `pairs`, their distances.
    """
    results = read_results(path, NAME)
    finest = tip(results, SELF, FINEST)
    found = []
    for one in results:
        heights = np.array(one.numbers["tip"])
        first, last = 1e3 * heights[[round(1 / EVERY), -1]]
        numbers = {"tip at 1 s": first, "tip at 2 s": last, "unknowns": one.numbers["dofs"]}
        numbers |= {"CPU": one.numbers["cpu"], **distances(heights, finest)}
        found.append(Result({"run": model_text(one.values)}, numbers, one.seconds))
    for words, (first_tip, second_tip) in pairs(results).items():
        found.append(Result({"pair": words}, distances(first_tip, second_tip), 0.0))
    return found


def distances(one: Array, other: Array) -> dict[str, float]:
    """`differences` by name."""
    names = ("distance at 1 s", "distance at 2 s", "largest distance")
    return dict(zip(names, differences(one, other), strict=True))


def pairs(results: Sequence[Result]) -> dict[str, tuple[Array, Array]]:
    """Displacements of the tip in two runs that are compared, by what is compared."""
    shell = tip(results, SELF, SHELL)
    stiff = tip(results, SELF, STIFF)
    reference = tip(results, "ngsolve", REFERENCE)
    coarse = tip(results, SELF, {"cells": 3, "elements": 6, "dt": 0.01, "shell": True})
    wrinkled = {"cells": 6, "elements": 12, "dt": 0.01, "order": 2}
    found = {
        "both programs, 3 × 3 cells": (coarse, tip(results, "ngsolve", COARSE)),
        "both programs, 6 × 6 cells": (shell, reference),
        "both programs, stiff booms": (stiff, reference),
        "both programs, other points": (shell, tip(results, "ngsolve", SAMPLED)),
        "booms that bend": (shell, stiff),
        "198 elements a boom": (shell, tip(results, SELF, FINE_BOOMS)),
        "steps of 5 ms": (shell, tip(results, SELF, SHORTER_STEP)),
        "a film that wrinkles": (shell, tip(results, SELF, wrinkled)),
    }
    for coarser, finer in pairwise(SERIES):
        words = f"{coarser['cells']} to {finer['cells']} cells"
        found[words] = (tip(results, SELF, coarser), tip(results, SELF, finer))
    return found


def table(found: Sequence[Result]) -> str:
    """What `figures` returns, as a table of Markdown; a pair has distances only."""
    names = list(found[0].numbers)
    rows = [["run or pair", *names]]
    for one in found:
        numbers = [f"{one.numbers[name]:.5g}" if name in one.numbers else "" for name in names]
        rows.append([*one.values.values(), *numbers])
    return markdown_table(rows)


def main() -> None:
    """Draw and print all results."""
    # Each run is of one process.
    if MPI.COMM_WORLD.rank == 0:
        results = all_results()
        draw(results, Path("out") / NAME / f"{NAME}.png")
        print(table(figures()))


if __name__ == "__main__":
    main()
