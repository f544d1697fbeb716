"""What several demos share.

Errors of the package end a demo that is run as a script, `python demos/sails/yo_yo.py`, with one
sentence, as they end `./gossamer demo yo_yo`.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import TracebackType

from mpi4py import MPI

from gossamer_fx.extend import errors_as_sentences

_usual = sys.excepthook


def _say(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print an error that users can mend as a sentence, and any other one with its trace."""
    try:
        with errors_as_sentences():
            raise error
    except SystemExit:
        # Python ends with the code of this exception.
        raise
    except BaseException:
        _usual(kind, error.with_traceback(trace), trace)


_script = Path(getattr(sys.modules["__main__"], "__file__", "")).resolve()
_is_demo = _script.is_relative_to(Path(__file__).absolute().parents[1].resolve())
# The hook of the package ends several ranks together, and has to see the error.
if _is_demo and MPI.COMM_WORLD.size == 1:
    sys.excepthook = _say
