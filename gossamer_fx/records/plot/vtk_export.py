"""Export of a recorded run as VTU and PVD files, for ParaView, VisIt and pyvista."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import OutputFailure, check
from gossamer_fx.records.fields.units import with_unit
from gossamer_fx.records.outputs.file_names import file_name
from gossamer_fx.records.outputs.vtu_format import (
    Entry,
    Grid,
    Integers,
    read_pvd,
    write_pvd,
    write_vtu,
)
from gossamer_fx.records.plot.plot import file_to_write
from gossamer_fx.records.plot.run_reader import RunReader

# Lists all parts of the scene.
_SCENE = "run.pvd"

# Parts that are not bodies with a mesh.  `file_name` keeps no brackets, so that no body has such a
# file name.
_SOLIDS = "solids ({})"
_CONNECTORS = "connectors (ropes, springs, tapes)"
_POINTS = "points (bodies without a mesh)"


@check_arguments
def export(run: RunReader, folder: str | Path) -> list[Path]:
    """Write all recorded states of a run as VTU files, and PVD files that list them.

    `run.pvd` has the whole scene: films, cables and beams with their fields, solids, ropes, springs
    and tapes as lines, and bodies without a mesh as points.  `NAME.pvd` has one of these
    parts; of a body that is named "run" it is `%72un.pvd`.
    Points are at their present positions, arrays have their units in their names, e.g. "stress1
    [Pa]", and cells of order 2 are cut into straight pieces.

    Args:
        run: a recorded run.
        folder: for the files only; it is made.  All files of an earlier export in it are removed.

    Returns:
        The PVD files; the first one has the whole scene.

    Raises:
        InputError: the run has no fields, its files cannot be read, or the folder holds anything
            that an export has not written.
        OutputFailure: a file cannot be written.

    Example:
        >>> [path.name for path in gx.plot.export(recorded, folder / "for ParaView")]
        ['run.pvd', 'film.pvd']
    """
    run.require_fields()
    folder = Path(folder)
    file_to_write(folder / _SCENE)
    earlier = _earlier_export(folder)
    entries: dict[str, list[Entry]] = {}
    try:
        # The earlier export may have had more times, or other bodies.
        for path in earlier:
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()
        for number in range(len(run.times)):
            time = float(run.times[number])
            for part, (name, grid) in enumerate(_grids(run, number)):
                files = folder / f"{name}_files"
                if name not in entries:
                    files.mkdir()
                    entries[name] = []
                file = f"{files.name}/{number:05d}.vtu"
                write_vtu(folder / file, grid)
                entries[name].append(Entry(time, part, file))
        lists = [folder / _SCENE]
        everything = [entry for of_part in entries.values() for entry in of_part]
        write_pvd(lists[0], sorted(everything, key=lambda entry: (entry.time, entry.part)))
        for name, of_part in entries.items():
            lists.append(folder / f"{name}.pvd")
            write_pvd(lists[-1], [Entry(entry.time, 0, entry.file) for entry in of_part])
    except OSError as error:
        raise OutputFailure(
            f"Cannot write to '{folder}' ({error.strerror}); choose a folder that is writable."
        ) from error
    return lists


def _earlier_export(folder: Path) -> list[Path]:
    """All that an earlier export has left in a folder: lists, and folders of the files they list.

    Raises:
        InputError: the folder holds anything else, or its list of files is damaged.
    """
    found = sorted(folder.iterdir())
    expected = set()
    scene = folder / _SCENE
    if scene.is_file():
        expected.add(_SCENE)
        for entry in read_pvd(scene):
            files = Path(entry.file).parts[0]
            expected |= {files, f"{files.removesuffix('_files')}.pvd"}
    # A recording of a body named "run" has a run.pvd, too, which lists this folder.
    expected.discard(f"{_SCENE.removesuffix('.pvd')}_files")
    for path in found:
        check(
            path.name in expected,
            f"'{folder}' holds '{path.name}', which is not part of an export; give another folder.",
        )
    return found


def _part_name(body: str) -> str:
    """File name of a body without its ending; different bodies have different ones."""
    name = file_name(body)
    if name == _SCENE.removesuffix(".pvd"):
        # The list of the whole scene has this name.  As in `file_name`, %72 stands for the r.
        return f"%{ord(name[0]):02X}{name[1:]}"
    return name


def _grids(run: RunReader, frame: int) -> Iterator[tuple[str, Grid]]:
    """The parts of the scene in a recorded state, by names of files.

    Yields:
        Name of the file without its ending, and points (p, 3) [m], cells and arrays at points in SI
        units.

    Raises:
        InputError: the files of the run cannot be read.
    """
    for name, body in run.bodies.items():
        segment, step = body.at(frame)
        arrays = {with_unit(field): segment.components(field, step) for field in run.fields[name]}
        yield _part_name(name), Grid(segment.positions(step), segment.pieces, arrays)
    time = float(run.times[frame])
    points = run.solid_points(time)
    for kind, size in (("triangles", 3), ("lines", 2)):
        cells: list[Integers] = [np.zeros((0, size), dtype=np.int64)]
        count = 0
        for X, solid in zip(points, run.solids, strict=True):
            cells.append(getattr(solid, kind) + count)
            count += len(X)
        joined = np.concatenate(cells)
        if len(joined):
            yield _SOLIDS.format(kind), Grid(np.concatenate(points), joined, {})
    ends = run.connector_lines(time).reshape(-1, 3)
    if len(ends):
        yield _CONNECTORS, Grid(ends, np.arange(len(ends)).reshape(-1, 2), {})
    dots = run.dots(time)
    if len(dots):
        yield _POINTS, Grid(dots, np.arange(len(dots))[:, None], {})
