"""Checks of the files that a function of the user gives to gmsh: STEP, STL and others.

gmsh opens whatever it is told, also a FIFO, on which it would wait; and the time in which it reads
a STEP file grows with the square of the number of solids.  So a file is looked at before gmsh
begins: the time is estimated from the text.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.strange_files import open_file

# Entities of a STEP file that are counted: faces, solids, and where solids are put in an assembly.
_FACES = (b"ADVANCED_FACE", b"FACE_SURFACE")
_SOLIDS = (b"MANIFOLD_SOLID_BREP", b"BREP_WITH_VOIDS")
_COPIES = (b"NEXT_ASSEMBLY_USAGE_OCCURRENCE",)

# Seconds of gmsh 4.13 on a machine of 2024, for boxes: 1.5 ms to read a face and 0.9 ms to mesh it;
# and 30 s to give 800 solids their names, which takes 5 times as long for twice as many.
_SECONDS_OF_FACE = 2e-3
_SECONDS_OF_NAMES = 4e-5

# Bytes that are searched at once, and bytes that the longest name of an entity may have.
_CHUNK = 1 << 24
_LONGEST_NAME = 40


def check_what_gmsh_reads(time_limit: float) -> None:
    """Let the functions of gmsh that read files check them first, in this process; see
    `check_geometry` for the errors.

    Args:
        time_limit: [s] that gmsh has.
    """
    import gmsh

    def checked(read: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(read)
        def check_and_read(fileName: str, *given: Any, **named: Any) -> Any:
            has_names = bool(gmsh.option.getNumber("Geometry.OCCImportLabels"))
            check_geometry(Path(fileName), time_limit, has_names)
            return read(fileName, *given, **named)

        return check_and_read

    gmsh.open = checked(gmsh.open)
    gmsh.merge = checked(gmsh.merge)
    occ = gmsh.model.occ
    occ.importShapes = staticmethod(checked(occ.importShapes))
    occ.import_shapes = occ.importShapes


def check_geometry(path: Path, time_limit: float, has_names: bool = True) -> None:
    """Check a file that gmsh is to read.

    Args:
        time_limit: [s] that gmsh has.
        has_names: whether gmsh gives the solids of a STEP file their names.

    Raises:
        InputError: it is not a regular file, or gmsh would need more time.
    """
    try:
        file = open_file(path)
    except OSError:
        # gmsh has its own words for a file that is not there.
        return
    with file:
        if path.suffix.lower() not in (".step", ".stp"):
            return
        faces = 0
        solids = 0
        copies = 0
        # The end of a part that was searched, without a name that was counted there.
        rest = b""
        while part := file.read(_CHUNK):
            text = rest + part
            faces += _count(text, _FACES, len(rest))
            solids += _count(text, _SOLIDS, len(rest))
            copies += _count(text, _COPIES, len(rest))
            rest = text[-_LONGEST_NAME:]
    solids = max(solids, copies)
    seconds = _SECONDS_OF_FACE * faces
    if has_names:
        seconds += _SECONDS_OF_NAMES * solids**2
    remedy = "give a larger time_limit, or write the parts that you need to a file of their own"
    if has_names:
        remedy += (
            "; without the names of parts it takes gmsh less: "
            "gmsh.option.setNumber('Geometry.OCCImportLabels', 0)"
        )
    check(
        seconds <= time_limit,
        f"'{path}' has {solids} solids with {faces} faces, which take gmsh about {seconds:.2g} s, "
        f"more than the {time_limit:g} s that it has; {remedy}.",
    )


def _count(text: bytes, names: tuple[bytes, ...], before: int) -> int:
    """How often names occur in a text, without those that end in its first bytes, `before`."""
    return sum(text.count(name) - text[:before].count(name) for name in names)
