"""The compiled C functions of contact."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from gossamer_fx.core.forms.c_source import CLibrary, c_library

# It says what each function does, and its arrays; there is one C file a stage.
HEADER = Path(__file__).parent / "contact.h"


# Asked for some fifteen times in an iteration: the path of the header takes longer to hash.
@cache
def library() -> CLibrary:
    """Return the C functions; on several ranks `c_library(HEADER, comm)` compiles them before."""
    return c_library(HEADER)
