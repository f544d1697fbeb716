"""ADIOS2 for Python, which reads the fields that runs have written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gossamer_fx.core.checks.errors import InputError


def adios2_for(path: Path) -> Any:
    """The Python module `adios2` (the library that reads and writes BP files), for reading a file.

    Args:
        path: of the file that is to be read; only for the message.

    Raises:
        InputError: this Python has no ADIOS2.
    """
    import dolfinx  # noqa: F401 (the wheels of both have libraries of one name: adios2 goes second)

    try:
        import adios2
    except ImportError as error:
        raise InputError(
            f"'{path}' cannot be read: this Python has no ADIOS2; install 'adios2', or open the "
            "file in ParaView."
        ) from error
    return adios2
