"""The file formats VTU, VTM and PVD of VTK: grids with arrays, named groups of them, and their
times.

A `.vtu` file is an XML head, and behind it the arrays as binary blocks.  A block has a header of
four integers, and the numbers of the array, compressed by zlib.  A `.vtm` file lists the files of
the items of a scene by name, a `.pvd` file those of a run by time; several of one time are parts of
one body, e.g. the shares of ranks.  ParaView, VisIt and pyvista read all of them without further
libraries.

Source: VTK File Formats, docs.vtk.org, sections "XML File Formats" and "PVD File Format".
"""

from __future__ import annotations

import math
import os
import re
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from io import BufferedWriter
from pathlib import Path
from typing import BinaryIO, NamedTuple
from xml.etree import ElementTree
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.checks.errors import InputError, are_usual_sizes
from gossamer_fx.core.checks.strange_files import (
    check_expansion,
    open_file,
    open_to_write,
    write_new,
)
from gossamer_fx.core.mesh.linear_pieces import from_vtk, to_vtk
from gossamer_fx.core.model.body import Array

Integers = npt.NDArray[np.integer]

# VTK's numbers of the kinds of cells, by the dimension of a cell and its number of nodes.
_CELL_TYPES = {(0, 1): 1, (1, 2): 3, (2, 3): 5, (1, 3): 21, (2, 6): 22}

# VTK's names of the types of numbers that are written.
_TYPE_NAMES = {"<f8": "Float64", "<i4": "Int32", "|u1": "UInt8"}
_TYPES = {name: kind for kind, name in _TYPE_NAMES.items()}

# Of zlib: the fastest level, and the one that only stores.
_COMPRESSION = 1
_STORED = 0

# Displacements hardly shrink, but cost 20 times the time of storing them; states and the numbers of
# nodes shrink to a tenth.  The first bytes of an array tell which it is.
_SAMPLE_BYTES = 1 << 16
_WORTHWHILE = 0.75  # compressed size over size up to which an array is compressed

# A header has the numbers of blocks, of bytes of a block and of the last one, and of its compressed
# bytes; that of an array without numbers has the first one only.
_HEADER_NUMBER = 8  # bytes of each
_HEAD_END = b'<AppendedData encoding="raw">\n_'
_FILE_END = b"\n</AppendedData>\n</VTKFile>\n"
_MAX_HEAD_BYTES = 1 << 20  # a file without arrays behind its head is not read to its end

# What the reading of a damaged file raises.
_DAMAGE = (
    OSError,
    ValueError,
    KeyError,
    TypeError,
    OverflowError,
    ElementTree.ParseError,
    expat.ExpatError,
    zlib.error,
)

# Behind the name of a list that is being written.
NEW = ".new"

# Characters that no XML file can hold.
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True)
class Grid:
    """An unstructured grid, whose cells are of one kind.

    Attributes:
        points: (p, 3) [m].
        cells: points (n, k) of the cells, in the order of dolfinx.
        dimension: of the cells: 0 for points, 1 for lines and 2 for triangles.
        arrays: values (p,) or (p, 3) at the points, by name.
        cell_arrays: values (n,) or (n, 3) in the cells, by name.
    """

    points: Array
    cells: Integers
    dimension: int
    arrays: Mapping[str, Array] = field(default_factory=dict)
    cell_arrays: Mapping[str, Array] = field(default_factory=dict)


class Entry(NamedTuple):
    """A line of a PVD file: a time [s], the number of a part at that time, and the file's path.

    A tuple, as there may be a million."""

    time: float
    part: int
    file: str


@dataclass(frozen=True)
class DataArray:
    """An array as it is in a file: the attributes of its XML element, and its bytes."""

    attributes: str
    content: bytes


# ---- writing -------------------------------------------------------------------------------------


def cell_blocks(cells: Integers, dimension: int) -> list[DataArray]:
    """The cells of a grid as blocks of a VTU file, which may be used for many files.

    Args:
        cells: points (n, k) of the cells, in the order of dolfinx.
    """
    count, nodes_of_cell = cells.shape
    ends = nodes_of_cell * np.arange(1, count + 1)
    types = np.full(count, _CELL_TYPES[dimension, nodes_of_cell], dtype=np.uint8)
    return [
        _block("connectivity", to_vtk(cells).ravel().astype("<i4")),
        _block("offsets", ends.astype("<i4")),
        _block("types", types),
    ]


def write_vtu(path: Path, grid: Grid, cells: Sequence[DataArray] = ()) -> None:
    """Write a grid as VTU, an XML format of VTK.

    Args:
        cells: the blocks of `cell_blocks`, if there are any already; else they are made.
    """
    sections = {
        "PointData": [_block(name, values) for name, values in grid.arrays.items()],
        "CellData": [_block(name, values) for name, values in grid.cell_arrays.items()],
        "Points": [_block("Points", grid.points)],
        "Cells": list(cells) or cell_blocks(grid.cells, grid.dimension),
    }
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt64" compressor="vtkZLibDataCompressor">',
        "<UnstructuredGrid>",
        f'<Piece NumberOfPoints="{len(grid.points)}" NumberOfCells="{len(grid.cells)}">',
    ]
    blocks: list[DataArray] = []
    offset = 0
    for section, members in sections.items():
        lines.append(f"<{section}>")
        for block in members:
            lines.append(f'<DataArray {block.attributes} format="appended" offset="{offset}"/>')
            offset += len(block.content)
        lines.append(f"</{section}>")
        blocks += members
    lines += ["</Piece>", "</UnstructuredGrid>", ""]
    with BufferedWriter(open_to_write(path, "wb")) as file:
        file.write("\n".join(lines).encode() + _HEAD_END)
        for block in blocks:
            file.write(block.content)
        file.write(_FILE_END)


def _block(name: str, values: npt.NDArray) -> DataArray:
    """An array (n,) or (n, k) of floating-point numbers, 32-bit integers or bytes as a block."""
    if values.dtype.kind == "f":
        values = values.astype("<f8")
    content = np.ascontiguousarray(values).tobytes()
    components = 1
    if values.ndim == 2:
        components = values.shape[1]
    attributes = (
        f'type="{_TYPE_NAMES[values.dtype.str]}" Name={quoteattr(name)} '
        f'NumberOfComponents="{components}"'
    )
    # An array without numbers has no block of compressed bytes.
    if not content:
        return DataArray(attributes, np.zeros(1, dtype="<u8").tobytes())
    sample = content[:_SAMPLE_BYTES]
    level = _STORED
    if len(zlib.compress(sample, _COMPRESSION)) < _WORTHWHILE * len(sample):
        level = _COMPRESSION
    compressed = zlib.compress(content, level)
    # One block: its length is that of the whole array.
    header = np.array([1, len(content), len(content), len(compressed)], dtype="<u8")
    return DataArray(attributes, header.tobytes() + compressed)


def write_vtm(path: Path, parts: Iterable[tuple[str, str]]) -> None:
    """Write a VTM file, which lists the items of a scene: name and VTU file of each."""
    elements = []
    for number, (name, file) in enumerate(parts):
        shown = _NOT_XML.sub("\ufffd", name)
        elements.append(
            f'<DataSet index="{number}" name={quoteattr(shown)} file={quoteattr(file)}/>'
        )
    _write_list(path, "vtkMultiBlockDataSet", elements)


def write_pvd(path: Path, entries: Iterable[Entry]) -> None:
    """Write a PVD file, which lists files with their times.

    Args:
        entries: time [s], part and file name of each file.
    """
    elements = []
    for entry in entries:
        elements.append(
            f'<DataSet timestep="{float(entry.time)!r}" part="{entry.part}" '
            f"file={quoteattr(entry.file)}/>"
        )
    _write_list(path, "Collection", elements)


def _write_list(path: Path, kind: str, elements: Sequence[str]) -> None:
    """Write a list of files; a reader finds the former or the new contents, never a part of
    them."""
    lines = [
        '<?xml version="1.0"?>',
        f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian">',
        f"<{kind}>",
        *elements,
        f"</{kind}>",
        "</VTKFile>",
    ]
    new = path.with_name(path.name + NEW)
    write_new(new, "\n".join(lines).encode())
    os.replace(new, path)


# ---- reading -------------------------------------------------------------------------------------


def read_vtu(path: Path, folder: Path | None = None) -> Grid:
    """Read a grid that `write_vtu` wrote.

    Args:
        folder: in which the file must be, also behind links; default: that of its path.
    """
    try:
        check_end(path, folder)
        with open_file(path, folder or path.parent) as file:
            root, start = _head(file)
            _check_sizes(path, file, start, root)
            arrays: dict[str, dict[str, npt.NDArray]] = {}
            for section in ("PointData", "CellData", "Points", "Cells"):
                arrays[section] = {}
                for element in root.iterfind(f"UnstructuredGrid/Piece/{section}/DataArray"):
                    arrays[section][element.attrib["Name"]] = _values(file, start, element)
        points = arrays["Points"]["Points"].reshape(-1, 3)
        cells, dimension = _cells(**arrays["Cells"])
        if len(cells) and not 0 <= cells.min() <= cells.max() < len(points):
            raise ValueError("a cell has a point that does not exist")
        if any(len(values) != len(points) for values in arrays["PointData"].values()):
            raise ValueError("an array has another number of points")
        if any(len(values) != len(cells) for values in arrays["CellData"].values()):
            raise ValueError("an array has another number of cells")
        if not are_usual_sizes(points):
            raise ValueError("a point is not at numbers up to 1e100 m")
        for name, values in (*arrays["PointData"].items(), *arrays["CellData"].items()):
            # A field may be unknown somewhere.
            if not are_usual_sizes(np.where(np.isnan(values), 0.0, values)):
                raise ValueError(f"'{name}' has values that are not numbers up to 1e100")
    except InputError:
        raise
    except _DAMAGE as error:
        raise _damaged(path, error) from error
    return Grid(points, cells, dimension, arrays["PointData"], arrays["CellData"])


def _damaged(path: Path, error: Exception) -> InputError:
    """The error about a file that cannot be read."""
    return InputError(
        f"'{path}' is missing or damaged ({error}); put back a copy of it, or write the run again."
    )


def check_end(path: Path, folder: Path | None = None) -> None:
    """Raise `InputError` if a VTU file is missing or has lost its end.

    It is written from its beginning to its end, so that one that lacks a part lacks its end.

    Args:
        folder: in which the file must be, also behind links; default: that of its path.
    """
    try:
        with open_file(path, folder or path.parent) as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(size - len(_FILE_END), 0))
            if file.read() != _FILE_END:
                raise ValueError("its end is missing")
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise _damaged(path, error) from error


def _head(file: BinaryIO) -> tuple[ElementTree.Element, int]:
    """The XML head of an open VTU file, and the position behind it, where the arrays begin."""
    head = b""
    while _HEAD_END not in head:
        more = file.read(_SAMPLE_BYTES)
        if not more or len(head) > _MAX_HEAD_BYTES:
            raise ValueError("it has no arrays behind its head")
        head += more
    start = head.index(_HEAD_END) + len(_HEAD_END)
    return _parsed(head[: start - len(_HEAD_END)] + b"</VTKFile>"), start


def _check_declarations(text: bytes) -> None:
    """Raise `ValueError` if an XML text has declarations, which could name other files or grow."""
    if b"<!" in text:
        raise ValueError("it has declarations")


def _parsed(text: bytes) -> ElementTree.Element:
    """The root of an XML text without declarations."""
    _check_declarations(text)
    return ElementTree.fromstring(text)


def _check_sizes(path: Path, file: BinaryIO, start: int, root: ElementTree.Element) -> None:
    """Raise `ValueError` if the arrays of an open VTU file would be much larger than the file.

    `start`: position behind the head of the file, from which offsets count.
    """
    file_size = file.seek(0, os.SEEK_END)
    claimed = 0
    for element in root.iter("DataArray"):
        file.seek(start + int(element.attrib["offset"]))
        header = file.read(2 * _HEADER_NUMBER)
        # The number of blocks, then the bytes of a block; an array without values has no block.
        if any(header[:_HEADER_NUMBER]):
            claimed += int.from_bytes(header[_HEADER_NUMBER:], "little")
    check_expansion(path, claimed, file_size)


def _values(file: BinaryIO, start: int, element: ElementTree.Element) -> npt.NDArray:
    """The values (n,) or (n, k) of an array in an open VTU file.

    `start`: position behind the head of the file, from which offsets count.  The array is one zlib
    block, as `_block` writes it: its head has the number of blocks (1, or 0 without values, and
    nothing follows), the bytes of a block, those of the last block, and the bytes when compressed.
    """
    kind = np.dtype(_TYPES[element.attrib["type"]])
    components = int(element.attrib["NumberOfComponents"])
    file_size = file.seek(0, os.SEEK_END)
    file.seek(start + int(element.attrib["offset"]))
    block_count = int.from_bytes(file.read(_HEADER_NUMBER), "little")
    content = b""
    if block_count:
        header = np.frombuffer(file.read(3 * _HEADER_NUMBER), dtype="<u8")
        size, _, compressed_size = (int(number) for number in header)
        compressed = file.read(min(compressed_size, file_size))
        # No more than the header says: a small file of a stranger could fill the memory.
        content = zlib.decompressobj().decompress(compressed, size + 1)
        if len(content) != size:
            raise ValueError("an array has another length than its header says")
    values = np.frombuffer(content, dtype=kind)
    if components > 1:
        return values.reshape(-1, components)
    return values


def _cells(connectivity: Integers, offsets: Integers, types: Integers) -> tuple[Integers, int]:
    """Cells (n, k) in the order of dolfinx, and their dimension; of a grid without cells 0."""
    if not len(types):
        return np.zeros((0, 1), dtype=np.int64), 0
    kinds = {number: kind for kind, number in _CELL_TYPES.items()}
    dimension, nodes_of_cell = kinds[int(types[0])]
    expected = nodes_of_cell * np.arange(1, len(types) + 1)
    if (types != types[0]).any() or not np.array_equal(offsets, expected):
        raise ValueError("its cells are of several kinds")
    cells = connectivity.reshape(len(types), nodes_of_cell)
    return from_vtk(cells), dimension


def read_pvd(path: Path, folder: Path | None = None) -> list[Entry]:
    """The entries of a PVD file that `write_pvd` wrote: time [s], part, and file.

    Args:
        folder: in which the file must be, also behind links; default: that of its path.
    """
    entries: list[Entry] = []
    try:
        with open_file(path, folder or path.parent) as file:
            content = file.read()
        _check_declarations(content)

        def note(kind: str, attributes: dict[str, str]) -> None:
            """Note an element, without a tree of all, which takes ten times the memory."""
            if kind == "DataSet":
                time = float(attributes["timestep"])
                if not math.isfinite(time):
                    raise ValueError(f"it has the time {time}")
                entries.append(Entry(time, int(attributes["part"]), attributes["file"]))

        parser = expat.ParserCreate()
        parser.StartElementHandler = note
        parser.Parse(content, True)
    except InputError:
        raise
    except _DAMAGE as error:
        raise _damaged(path, error) from error
    for entry in entries:
        # A sentence for what is wrong only: a million take seconds.
        if entry.file.startswith("/") or ".." in entry.file.split("/"):
            raise InputError(
                f"'{path}' names '{entry.file}', which is outside its folder; write the run again."
            )
    return entries
