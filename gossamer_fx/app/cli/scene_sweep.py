"""Sweeps over the arguments of a scene file: gossamer sweep SCENE --over NAME=VALUE,VALUE ..."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

from gossamer_fx.analysis.cases.case_runs import Build, CaseRuns
from gossamer_fx.app.cli.user_files import check_arguments_of, option, value_of
from gossamer_fx.app.sweep.factorial import Factorial
from gossamer_fx.core.checks.errors import InputError, check, on_rank_zero
from gossamer_fx.core.checks.strange_files import open_file, read_json
from gossamer_fx.records.outputs.output import make_parent, replace_file


def values_of(words: Sequence[str]) -> dict[str, list[Any]]:
    """Values of arguments, by name, from words NAME=VALUE,VALUE of a command line.

    Args:
        words: e.g. "cells=4,8"; a value is a number, True, False, or else a word.

    Raises:
        InputError: a word of another form, a name without a value, or one that is given twice.
    """
    over: dict[str, list[Any]] = {}
    for word in words:
        name, value = option(word)
        values = list(value) if isinstance(value, tuple) else [value]
        if isinstance(value, str):
            values = [value_of(part.strip()) for part in value.split(",")]
        check(
            "" not in values,
            f"'{word}' is not of the form NAME=VALUE,VALUE; give arguments of build like "
            "cells=4,8,16.",
        )
        check(name not in over, f"--over has {name} twice; give all its values at once.")
        over[name] = values
    return over


def check_same_scene(comm: MPI.Intracomm, path: Path, folder: Path) -> None:
    """Refuse a folder whose runs are of another scene file, or of this one before it was changed.

    The results of runs are found by the values of their arguments, which do not tell the scene.  A
    new folder gets the checksum of the file.  Collective.

    Args:
        comm: the ranks; rank 0 reads the files.
        path: of the scene file.
        folder: of the sweep; made if it does not exist.

    Raises:
        InputError: on all ranks; names both files.
        OutputFailure: on all ranks, if the checksum cannot be written.
        OSError: on all ranks, if a file cannot be read.
    """

    def compare() -> None:
        """Compare the checksum of the scene file with the one in the folder, or store it there.

        Raises:
            InputError: the folder has another checksum.
            OutputFailure: the checksum cannot be written.
            OSError: a file cannot be read.
        """
        with open_file(path) as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        mark = folder / "scene.json"
        make_parent(MPI.COMM_SELF, mark)
        if mark.is_file():
            try:
                about = dict(read_json(mark, folder))
            except InputError:
                raise
            except (ValueError, TypeError) as error:
                raise InputError(f"'{mark}' is damaged ({error}); remove the folder.") from error
            check(
                about.get("sha256") == digest,
                f"'{folder}' holds runs of '{about.get('file')}' as it was before a change, or of "
                "another scene; give another folder with --output, or remove this one.",
            )
        else:
            replace_file(mark, json.dumps({"file": str(path), "sha256": digest}))

    on_rank_zero(comm, compare)


def scene_sweep(
    build: Build,
    path: Path,
    words: Sequence[str],
    *,
    fixed: Sequence[str],
    listed: bool,
    progress: Callable[[str], None],
) -> Factorial:
    """The sweep over arguments of a scene file that a command line asks for.

    Args:
        build: the function of the scene file.
        path: of the scene file.
        words: NAME=VALUE,VALUE for each argument that is varied.
        fixed: NAME=VALUE for arguments that are the same in all runs.
        listed: whether the values belong together one by one; else all combinations are run.
        progress: called with a line when a run begins.

    Returns:
        The sweep, not yet run.

    Raises:
        InputError: words of another form, unknown arguments, or values that make no sweep.
    """
    over = values_of(words)
    count = max(len(values) for values in over.values()) if listed else 1
    for word in fixed:
        name, value = option(word)
        check(name not in over, f"{name} is given twice, by '{word}'; give it once.")
        over[name] = [value] * count
    given = [(name, value) for name, values in over.items() for value in values]
    check_arguments_of(build, path, given)
    return Factorial(CaseRuns(build, progress), over, listed=listed)
