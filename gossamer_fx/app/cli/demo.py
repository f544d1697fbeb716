"""Run a program of the folder `demos`: gossamer demo [NAME] [ARGUMENTS], gossamer validate NAME
[ARGUMENTS]."""

from __future__ import annotations

import ast
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from gossamer_fx.app.cli.script import AS_DEMO, BEHIND_THE_DOOR

# the picture of the README
DEFAULT = "folded_tube"
# folders of `demos` that are not subjects: their programs have separate launchers
OTHER_FOLDERS = {"common", "studies", "validation", "benchmarks"}


def find_demos() -> Path | None:
    """The folder of the demos: that of the clone of this package, else one in the current folder.

    A folder counts if it has the demo that runs without a name, `DEFAULT`.

    Returns:
        Absolute path; None if there is none: an installed package has no demos.
    """
    clone = Path(__file__).resolve().parents[3]
    for folder in (clone / "demos", Path("demos").resolve()):
        if DEFAULT in demos_of(folder):
            return folder
    return None


def demos_of(folder: Path) -> dict[str, Path]:
    """The programs in the folders of the subjects, by their names without .py."""
    programs = sorted(folder.glob("*/*.py"), key=lambda path: path.stem)
    return {path.stem: path for path in programs if path.parent.name not in OTHER_FOLDERS}


def main(words: Sequence[str]) -> int:
    """Replace this process by a demo.

    Args:
        words: the name of a demo, the default one if it is left out, then the demo's own arguments,
            or --help for what it is about.

    Returns:
        Exit code 2 if there is no such demo, no folder of demos, or the demo takes no arguments; 0
        after --help; else it does not return.
    """
    rest = list(words)
    name = DEFAULT
    if rest and not rest[0].startswith("-"):
        name = rest.pop(0).removesuffix(".py")
    folder = find_demos()
    if folder is None:
        return _tell_where_demos_are("demo")
    demos = demos_of(folder)
    if name not in demos:
        sys.stderr.write(f"gossamer: there is no demo '{name}'; give one of {', '.join(demos)}.\n")
        return 2
    source = demos[name].read_text(encoding="utf-8")
    if {"-h", "--help"} & set(rest):
        sys.stdout.write(f"{ast.get_docstring(ast.parse(source))}\n")
        return 0
    if rest and "sys.argv" not in source:
        sys.stderr.write(
            f"gossamer: the demo '{name}' takes no arguments; leave '{' '.join(rest)}' out, or see "
            f"gossamer demo {name} --help.\n"
        )
        return 2
    _replace_process(folder, demos[name], rest)


def validate(words: Sequence[str]) -> int:
    """Replace this process by the comparison of predictions with measurements.

    Args:
        words: a case or a case file, then the options of `demos/validation`.

    Returns:
        Exit code 2 if there is no folder of demos; else it does not return.
    """
    folder = find_demos()
    if folder is None:
        return _tell_where_demos_are("validate")
    _replace_process(folder, folder / "validation", list(words))


def _tell_where_demos_are(command: str) -> int:
    """Report that there are no demos; returns the exit code."""
    sys.stderr.write(
        "gossamer: there is no folder 'demos' here, and an installed package has none; "
        f"start gossamer {command} in a clone of the project.\n"
    )
    return 2


def _replace_process(folder: Path, program: Path, words: list[str]) -> NoReturn:
    """Replace this process by a program of the folder of the demos."""
    # demos import each other and the folder demos/common by their path in the clone
    # Parent of the package too, as the folder of a demo in the current folder may be another.
    package = str(Path(__file__).resolve().parents[3])
    paths = [str(folder.parent), package, os.environ.get("PYTHONPATH", "")]
    os.environ["PYTHONPATH"] = os.pathsep.join(path for path in paths if path)
    os.execv(sys.executable, [sys.executable, *BEHIND_THE_DOOR, AS_DEMO, str(program), *words])
