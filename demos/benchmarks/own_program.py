"""This program as a contestant: own_program.py PROBLEM [key=value ...] solves one problem.

The function of a problem has its name.  Its keyword arguments are the words of the problem, and it
returns figures by name.  The last line that is printed is a JSON
object with the figures, and with the warnings of the program.
"""

from __future__ import annotations

import importlib
import inspect
import json
import sys

import numpy as np
from contestants import words
from mpi4py import MPI

from gossamer_fx.analysis.cases.results import recorded_warnings

# Modules of problems that are not in `own_problems`.
MODULES = {
    "limit": "newton_times",
    "profile": "newton_times",
    "gradient": "gradient_cost",
    "contact_cost": "contact_cost",
}


def main() -> None:
    """Solve the problem that the command line names, and print its figures."""
    problem = sys.argv.pop(1)
    module = importlib.import_module(MODULES.get(problem, "own_problems"))
    solve = getattr(module, problem)
    defaults = {name: one.default for name, one in inspect.signature(solve).parameters.items()}
    with recorded_warnings() as own_warnings:
        figures = solve(**words(defaults))
    comm = MPI.COMM_WORLD
    warnings = [text for texts in comm.allgather(own_warnings) for text in texts]
    if comm.rank == 0:
        numbers = {name: float(np.real(value)) for name, value in figures.items()}
        print(json.dumps(numbers | {"warnings": list(dict.fromkeys(warnings))}))


if __name__ == "__main__":
    main()
