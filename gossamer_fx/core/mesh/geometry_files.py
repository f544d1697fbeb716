"""Checks of the files that a function of the user gives to gmsh: STEP, STL and others.

gmsh opens whatever it is told, also a FIFO, on which it would wait; and the time in which it reads
a STEP file grows with the square of the number of solids.  So a file is looked at before gmsh
begins: the time is estimated from the text.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, BinaryIO

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.strange_files import open_file

# Words that are counted: in a STEP file faces, solids, and solids that are put in an assembly; in
# an STL file its triangles and solids.
_FACES = {
    ".step": (b"ADVANCED_FACE", b"FACE_SURFACE"),
    ".stl": (b"outer loop",),
}
_SOLIDS = {
    ".step": (b"MANIFOLD_SOLID_BREP", b"BREP_WITH_VOIDS"),
    ".stl": (b"\nsolid",),
}
_COPIES = (b"NEXT_ASSEMBLY_USAGE_OCCURRENCE",)

# Seconds of gmsh 4.13 on a machine of 2024 for a face: 1.5 ms to read one of a box and 0.9 ms to
# mesh it; 1.5 s for 40 000 triangles of an STL file.
_SECONDS_OF_FACE = {".step": 2e-3, ".stl": 4e-5}
# Seconds over the square of the number of solids: 30 s to give 800 of a STEP file their names; 20 s
# for 20 000 of an STL file.
_SECONDS_OF_SOLIDS = {".step": 4e-5, ".stl": 5e-8}

# Bytes of a triangle in a binary STL file.
_BINARY_TRIANGLE = 50

# Bytes that are searched at once, and bytes that the longest word may have.
_CHUNK = 1 << 24
_LONGEST_WORD = 40


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
    kind = path.suffix.lower().replace(".stp", ".step")
    if kind not in _FACES:
        file.close()
        return
    size = os.fstat(file.fileno()).st_size
    with file:
        faces, solids, copies = _counts(file, (_FACES[kind], _SOLIDS[kind], _COPIES))
    solids = max(solids, copies)
    seconds = _SECONDS_OF_FACE[kind] * faces
    remedy = "give a larger time_limit, or write a file with the parts that you need"
    if kind == ".stl":
        if not faces:
            seconds = _SECONDS_OF_FACE[kind] * size / _BINARY_TRIANGLE
        seconds += _SECONDS_OF_SOLIDS[kind] * solids**2
    elif has_names:
        seconds += _SECONDS_OF_SOLIDS[kind] * solids**2
        remedy += (
            "; without the names of parts it takes gmsh less: "
            "gmsh.option.setNumber('Geometry.OCCImportLabels', 0)"
        )
    check(
        seconds <= time_limit,
        f"'{path}' has {solids} solids with {faces} faces, {size} bytes in all, which take gmsh "
        f"about {seconds:.2g} s, more than the {time_limit:g} s that it has; {remedy}.",
    )


def _counts(file: BinaryIO, kinds: tuple[tuple[bytes, ...], ...]) -> list[int]:
    """How often words of each kind occur in a file."""
    found = [0] * len(kinds)
    # The end of the part before, in which words may begin.
    rest = b""
    while part := file.read(_CHUNK):
        text = rest + part
        for number, words in enumerate(kinds):
            for word in words:
                found[number] += text.count(word) - rest.count(word)
        rest = text[-_LONGEST_WORD:]
    return found
