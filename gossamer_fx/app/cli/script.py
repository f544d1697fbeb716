"""Run a script behind the door: python3 -P -m gossamer_fx.app.cli.script [--demo] FILE [ARGUMENTS].

With --demo errors of the package end it with one sentence, as those of the commands do; in a script
of the user Python's trace says which of its lines to correct.

Libraries that the script imports before this package, e.g. mpi4py, read nothing in the current
folder either, see `gossamer_fx/core/checks/door.py`.
"""

from __future__ import annotations

import runpy
import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from gossamer_fx.core.checks.ctrl_c import is_first_rank, usual_ctrl_c
from gossamer_fx.core.checks.door import import_from, is_refusal
from gossamer_fx.core.checks.memory_limit import speak_if_killed

# The words before the file.
BEHIND_THE_DOOR = ("-P", "-m", "gossamer_fx.app.cli.script")
AS_DEMO = "--demo"


if __name__ == "__main__":
    usual_ctrl_c()
    speak_if_killed()
    is_demo = sys.argv[1] == AS_DEMO
    sys.argv = sys.argv[1 + is_demo :]
    program = Path(sys.argv[0])
    if not program.is_dir():
        # As Python does for a script; for a folder runpy does so itself.
        import_from(program.resolve().parent)
    try:
        said: AbstractContextManager[None] = nullcontext()
        if is_demo:
            from gossamer_fx.core.checks.errors import errors_as_sentences

            said = errors_as_sentences()
        with said:
            runpy.run_path(str(program), run_name="__main__")
    except ValueError as error:
        if not is_refusal(error):
            raise
        # All ranks have the same variables.
        sys.exit(f"gossamer: {error}" if is_first_rank() else 2)
