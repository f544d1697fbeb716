"""Run a script behind the door: python3 -P -m gossamer_fx.app.cli.script FILE [ARGUMENTS].

Libraries that the script imports before this package, e.g. mpi4py, read nothing in the current
folder either, see `gossamer_fx/core/checks/door.py`.
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

from gossamer_fx.core.checks.ctrl_c import is_first_rank, usual_ctrl_c
from gossamer_fx.core.checks.door import import_from, is_refusal
from gossamer_fx.core.checks.memory_limit import speak_if_killed

# The words before the file.
BEHIND_THE_DOOR = ("-P", "-m", "gossamer_fx.app.cli.script")


if __name__ == "__main__":
    usual_ctrl_c()
    speak_if_killed()
    program = Path(sys.argv[1])
    sys.argv = sys.argv[1:]
    if not program.is_dir():
        # As Python does for a script; for a folder runpy does so itself.
        import_from(program.resolve().parent)
    try:
        runpy.run_path(str(program), run_name="__main__")
    except ValueError as error:
        if not is_refusal(error):
            raise
        # All ranks have the same variables.
        sys.exit(f"gossamer: {error}" if is_first_rank() else 2)
