"""Run a demo: gossamer demo [NAME] [ARGUMENTS]."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

# the picture of the README
DEFAULT = "folded_tube"


def find_demos() -> Path | None:
    """The folder of the demos: that of the clone of this package, else one in the current folder.

    A wheel has none.
    """
    clone = Path(__file__).resolve().parents[2]
    for folder in (clone / "demos", Path("demos").resolve()):
        if (folder / f"{DEFAULT}.py").is_file():
            return folder
    return None


def main(words: Sequence[str]) -> int:
    """Replace this process by a demo; returns an exit code if there is no such demo.

    Args:
        words: the name of a demo, the default one if it is left out, then the demo's own arguments.
    """
    rest = list(words)
    name = DEFAULT
    if rest and not rest[0].startswith("-"):
        name = rest.pop(0).removesuffix(".py")
    folder = find_demos()
    if folder is None:
        sys.stderr.write(
            "gossamer: there is no folder 'demos' here, and an installed package has none; "
            "start gossamer demo in a clone of the project.\n"
        )
        return 2
    names = sorted(path.stem for path in folder.glob("*.py"))
    if name not in names:
        sys.stderr.write(f"gossamer: there is no demo '{name}'; give one of {', '.join(names)}.\n")
        return 2
    # demos import each other and the folder demos/common by their path in the clone
    paths = [str(folder.parent), os.environ.get("PYTHONPATH", "")]
    os.environ["PYTHONPATH"] = os.pathsep.join(path for path in paths if path)
    os.execv(sys.executable, [sys.executable, str(folder / f"{name}.py"), *rest])
