"""The file formats VTU and PVD of VTK: unstructured grids with arrays, and their times.

A `.vtu` file is XML.  Its arrays are binary: a header of three integers, and a block that zlib has
compressed, both in base 64.  A `.pvd` file lists `.vtu` files with their times; several files of
one time are parts of one scene, e.g. the shares of several ranks.  ParaView, VisIt and pyvista read
both without further libraries.

Source: VTK File Formats, docs.vtk.org, sections "XML File Formats" and "PVD File Format".
"""

from __future__ import annotations

import os
import zlib
from base64 import b64decode, b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.model.body import Array

Integers = npt.NDArray[np.integer]

# VTK's numbers of a point, a line and a triangle, by their numbers of nodes.
_CELL_TYPES = {1: 1, 2: 3, 3: 5}

# VTK's names of the types of numbers that are written.
_TYPE_NAMES = {"<f8": "Float64", "<i4": "Int32", "|u1": "UInt8"}
_TYPES = {name: kind for kind, name in _TYPE_NAMES.items()}

# Of zlib: the fastest level, which is within a tenth of the best size for floating-point numbers.
_COMPRESSION = 1

_HEADER_BYTES = 4 * 8  # blocks, bytes of a block, bytes of the last one, compressed bytes
_HEADER_LETTERS = 44  # of that header in base 64


@dataclass(frozen=True)
class Grid:
    """An unstructured grid.

    Attributes:
        points: (p, 3) [m].
        cells: points (n, k) of the cells: k is 1 for points, 2 for lines, 3 for triangles.
        arrays: values (p,) or (p, 3) at the points, by name.
    """

    points: Array
    cells: Integers
    arrays: Mapping[str, Array]


@dataclass(frozen=True)
class Entry:
    """A line of a PVD file: a time [s], the number of a part at that time, and the file's path."""

    time: float
    part: int
    file: str


def write_vtu(path: Path, grid: Grid) -> None:
    """Write a grid as VTU, an XML format of VTK.

    Args:
        path: of the file, which is replaced.
        grid: points, cells and arrays.

    Raises:
        OSError: the file cannot be written.
    """
    count = len(grid.cells)
    nodes_of_cell = grid.cells.shape[1]
    ends = nodes_of_cell * np.arange(1, count + 1)
    types = np.full(count, _CELL_TYPES[nodes_of_cell], dtype=np.uint8)
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt64" compressor="vtkZLibDataCompressor">',
        "<UnstructuredGrid>",
        f'<Piece NumberOfPoints="{len(grid.points)}" NumberOfCells="{count}">',
        "<PointData>",
    ]
    lines += [_array(name, values) for name, values in grid.arrays.items()]
    lines += ["</PointData>", "<Points>", _array("Points", grid.points), "</Points>", "<Cells>"]
    lines.append(_array("connectivity", grid.cells.ravel().astype("<i4")))
    lines.append(_array("offsets", ends.astype("<i4")))
    lines.append(_array("types", types))
    lines += ["</Cells>", "</Piece>", "</UnstructuredGrid>", "</VTKFile>", ""]
    path.write_text("\n".join(lines), encoding="utf-8")


def _array(name: str, values: npt.NDArray) -> str:
    """An array as an XML element of a VTU file, compressed, in base 64.

    Args:
        name: of the array, e.g. "stress1 [Pa]".
        values: (n,) or (n, k), floating-point numbers, 32-bit integers or bytes.

    Raises:
        KeyError: the numbers are of another type.
    """
    if values.dtype.kind == "f":
        values = values.astype("<f8")
    content = np.ascontiguousarray(values).tobytes()
    compressed = zlib.compress(content, _COMPRESSION)
    # One block: its length is that of the whole array.
    header = np.array([1, len(content), len(content), len(compressed)], dtype="<u8")
    # An array without numbers has no block.
    if not content:
        header = np.zeros(1, dtype="<u8")
        compressed = b""
    text = b64encode(header.tobytes()).decode() + b64encode(compressed).decode()
    components = 1
    if values.ndim == 2:
        components = values.shape[1]
    return (
        f'<DataArray type="{_TYPE_NAMES[values.dtype.str]}" Name={quoteattr(name)} '
        f'NumberOfComponents="{components}" format="binary">{text}</DataArray>'
    )


def read_vtu(path: Path) -> Grid:
    """Read a grid that `write_vtu` wrote.

    Args:
        path: of the file, which may come from a stranger.

    Returns:
        points (p, 3) [m], cells (n, k), and arrays (p,) or (p, 3) by name.

    Raises:
        InputError: the file is missing, damaged, or of another kind.
    """
    try:
        root = ElementTree.fromstring(path.read_text(encoding="utf-8"))
        arrays: dict[str, npt.NDArray] = {}
        for element in root.iter("DataArray"):
            arrays[element.attrib["Name"]] = _values(element)
        points = arrays.pop("Points")
        types = arrays.pop("types")
        del arrays["offsets"]
        nodes_of_cell = 1
        if len(types):
            nodes_of_cell = {kind: k for k, kind in _CELL_TYPES.items()}[int(types[0])]
        cells = arrays.pop("connectivity").reshape(-1, nodes_of_cell)
        if len(cells) and not 0 <= cells.min() <= cells.max() < len(points):
            raise ValueError("a cell has a point that does not exist")
        if any(len(values) != len(points) for values in arrays.values()):
            raise ValueError("an array has another number of points")
    except (OSError, ValueError, KeyError, ElementTree.ParseError, zlib.error) as error:
        raise InputError(
            f"'{path}' is missing or damaged ({error}); put back a copy of it, or write the run "
            "again."
        ) from error
    return Grid(points, cells.astype(np.int64), arrays)


def _values(element: ElementTree.Element) -> npt.NDArray:
    """The values (n,) or (n, k) of an array in a VTU file, of the type that is written in it.

    Raises:
        ValueError: its length is not that of its header, or it is not in base 64.
        KeyError: it is of a type that this package does not write, or an attribute is missing.
        zlib.error: the compressed block is damaged.
    """
    kind = np.dtype(_TYPES[element.attrib["type"]])
    components = int(element.attrib["NumberOfComponents"])
    text = element.text or ""
    content = b""
    if len(text) >= _HEADER_LETTERS:
        header = np.frombuffer(b64decode(text[:_HEADER_LETTERS])[:_HEADER_BYTES], dtype="<u8")
        decompressor = zlib.decompressobj()
        # No more than the header says: a small file of a stranger could fill the memory.
        content = decompressor.decompress(b64decode(text[_HEADER_LETTERS:]), int(header[1]) + 1)
        if len(content) != header[1]:
            raise ValueError("an array has another length than its header says")
    values = np.frombuffer(content, dtype=kind)
    if components > 1:
        return values.reshape(-1, components)
    return values


def write_pvd(path: Path, entries: Sequence[Entry]) -> None:
    """Write a PVD file, which lists VTU files with their times.

    A reader finds the former or the new contents, never a part of them.

    Args:
        path: of the file, which is replaced.
        entries: time [s], part and file name of each VTU file.

    Raises:
        OSError: the file cannot be written.
    """
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="Collection" version="1.0" byte_order="LittleEndian">',
        "<Collection>",
    ]
    for entry in entries:
        lines.append(
            f'<DataSet timestep="{float(entry.time)!r}" part="{entry.part}" '
            f"file={quoteattr(entry.file)}/>"
        )
    lines += ["</Collection>", "</VTKFile>", ""]
    new = path.with_name(f"{path.name}.new")
    new.write_text("\n".join(lines), encoding="utf-8")
    os.replace(new, path)


def read_pvd(path: Path) -> list[Entry]:
    """The entries of a PVD file that `write_pvd` wrote: time [s], part, and VTU file.

    Args:
        path: of the file, which may come from a stranger.

    Raises:
        InputError: the file is missing or damaged, or names a file outside its folder.
    """
    entries = []
    try:
        root = ElementTree.fromstring(path.read_text(encoding="utf-8"))
        for element in root.iter("DataSet"):
            time = float(element.attrib["timestep"])
            part = int(element.attrib["part"])
            entries.append(Entry(time, part, element.attrib["file"]))
    except (OSError, ValueError, KeyError, ElementTree.ParseError) as error:
        raise InputError(
            f"'{path}' is missing or damaged ({error}); put back a copy of it, or write the run "
            "again."
        ) from error
    for entry in entries:
        inside = Path(entry.file)
        check(
            not inside.is_absolute() and ".." not in inside.parts,
            f"'{path}' names '{entry.file}', which is outside its folder; write the run again.",
        )
    return entries
