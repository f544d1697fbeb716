"""What a child process gets: it imports this package, and nothing from the current folder."""

from __future__ import annotations

import os
from pathlib import Path

# A Python program as a child: without the current folder, whose files could stand for numpy and the
# like.
ISOLATED = "-P"


def child_environment() -> dict[str, str]:
    """The environment of a child that finds this package where the parent has found it."""
    home = str(Path(__file__).parents[3])
    paths = [home, os.environ.get("PYTHONPATH", "")]
    return os.environ | {"PYTHONPATH": os.pathsep.join(path for path in paths if path)}
