"""Export of a recorded run as one scene for ParaView, VisIt and pyvista."""

from __future__ import annotations

import math
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np

from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.checks.errors import check, output_failures
from gossamer_fx.records.fields.units import with_unit
from gossamer_fx.records.outputs.vtu_format import (
    NEW,
    Entry,
    Grid,
    Integers,
    read_pvd,
    write_pvd,
    write_vtm,
    write_vtu,
)
from gossamer_fx.records.plot.plot import file_to_write
from gossamer_fx.records.plot.run_reader import RunReader

# The list of all times, and the folder of the files that it lists.
_SCENE = "run.pvd"
_FILES = "run_files"


# Names of the files in that folder, and of one that is being written.
_OF_EXPORT = re.compile(rf"\d{{5,}}(_\d+\.vtu|\.vtm|\.vtm{re.escape(NEW)})")

# States that are written unasked: each takes two files and more, in all some ten seconds.
_MAX_STATES = 20_000


@check_arguments
def export(
    run: RunReader, folder: str | Path, *, every: Annotated[int, Range(1)] | None = None
) -> Path:
    """Write the recorded states of a run with all items of the scene, for ParaView and pyvista.

    `run.pvd` lists a state for each time.  Its parts have the names of films, cables and beams;
    "connectors" are ropes, springs and tapes with their mean tensions, "solids" rigid bodies and
    obstacles, "solid lines" their edges, and "points" bodies without a mesh.  A body alone is in
    the folder of the run already, `fields/NAME.pvd`.

    Args:
        run: a recorded run.
        folder: for the files only; it is made.  All files of an earlier export in it are removed.
        every: number of states of which one is written, and the last state; None: all, at most
            20 000.

    Returns:
        The path of `run.pvd`.

    Raises:
        InputError: the run has no fields, or more than 20 000 states of which `every` does not say
            how many are meant; its files cannot be read, or the folder holds anything that an
            export has not written.
        OutputFailure: a file cannot be written.

    Example:
        >>> gx.plot.export(recorded, folder / "for ParaView").name
        'run.pvd'
    """
    run.require_fields()
    count = len(run.times)
    fewer = math.ceil(count / _MAX_STATES)
    check(
        every is not None or count <= _MAX_STATES,
        f"The run in '{run.folder}' has {count} states, each of which takes two files or more; "
        f"give every = {fewer} (--every {fewer}) for {len(range(0, count, fewer))} of them, or "
        "1 for all.",
    )
    records = sorted({*range(0, count, every or 1), count - 1})
    folder = Path(folder)
    scene = folder / _SCENE
    files = folder / _FILES
    file_to_write(scene)
    _check_own(folder)
    entries = []
    with output_failures(folder):
        # The earlier export may have had more times, or other bodies.
        scene.unlink(missing_ok=True)
        if files.is_dir():
            shutil.rmtree(files)
        files.mkdir()
        for number, record in enumerate(records):
            parts = []
            for part, (name, grid) in enumerate(_parts(run, record)):
                file = f"{number:05d}_{part}.vtu"
                write_vtu(files / file, grid)
                parts.append((name, file))
            of_time = f"{number:05d}.vtm"
            write_vtm(files / of_time, parts)
            entries.append(Entry(float(run.times[record]), 0, f"{_FILES}/{of_time}"))
        write_pvd(scene, entries)
    return scene


def _check_own(folder: Path) -> None:
    """Check that a folder holds nothing but an earlier export."""
    own = [_SCENE + NEW]
    scene = folder / _SCENE
    files = folder / _FILES
    # A recording of a body named "run" has files of these names too, but lists no VTM files.
    if scene.is_file() and all(entry.file.endswith(".vtm") for entry in read_pvd(scene)):
        own += [_SCENE, _FILES]
    # An export that was ended has no list yet.
    elif (
        not scene.exists()
        and files.is_dir()
        and all(_OF_EXPORT.fullmatch(name) for name in os.listdir(files))
    ):
        own.append(_FILES)
    for path in sorted(folder.iterdir()):
        check(
            path.name in own,
            f"'{folder}' holds '{path.name}', which is not part of an export; give another folder.",
        )


def _parts(run: RunReader, record: int) -> Iterator[tuple[str, Grid]]:
    """The items of the scene in a recorded state by name, with arrays in SI units."""
    for name, body in run.bodies.items():
        segment, step = body.at(record)
        yield name, segment.grid(step)
    time = float(run.times[record])
    points = run.solid_points(time)
    for name, kind, dimension in (("solids", "triangles", 2), ("solid lines", "lines", 1)):
        cells: list[Integers] = [np.zeros((0, dimension + 1), dtype=np.int64)]
        count = 0
        for X, solid in zip(points, run.solids, strict=True):
            cells.append(getattr(solid, kind) + count)
            count += len(X)
        joined = np.concatenate(cells)
        if len(joined):
            yield name, Grid(np.concatenate(points), joined, dimension)
    ends = run.connector_lines(time).reshape(-1, 3)
    if len(ends):
        tensions = {with_unit("tension"): run.connector_tensions(time)}
        pairs = np.arange(len(ends)).reshape(-1, 2)
        yield "connectors", Grid(ends, pairs, 1, cell_arrays=tensions)
    dots = run.dots(time)
    if len(dots):
        yield "points", Grid(dots, np.arange(len(dots))[:, None], 0)
