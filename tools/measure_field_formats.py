"""Time and size of field files in the formats of ParaView: VTU, VTX, XDMF with HDF5, and VTKHDF.

    ./gossamer mpi 2 tools/measure_field_formats.py [CELLS]

A film of 2 CELLS² triangles moves; its displacement and two fields that jump between cells are
written at five times.  The table has the wall time of a record after the first one, which makes the
mesh too, and the bytes of a record and of what is written once.

VTKHDF is written by h5py from rank 0, as the h5py of package registries has no MPI; what HDF5 takes
when all ranks write is seen from XDMF.  A format whose library is absent is left out.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from dolfinx import has_adios2, io
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.records.fields.fields import FieldFunctions

COMM = MPI.COMM_WORLD
USUAL_CELLS = 577  # along each side: a million unknowns
RECORDS = 5
FIELDS = ("stress1", "state")

Write = Callable[[float], None]


def film_run(cells: int) -> tuple[gx.Simulation, gx.Membrane]:
    """A film that waves, at rest."""

    def wave(X: np.ndarray) -> np.ndarray:
        return np.vstack([0 * X[0], 0 * X[0], 0.1 * np.sin(7 * X[0]) * np.cos(5 * X[1])])

    law = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)
    film = gx.Membrane(sheet(COMM, cells, cells), law, displacement=wave, name="film")
    return gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3)), film


def vtu(run: gx.Simulation, film: gx.Membrane, folder: Path) -> Write:
    """The format of `gx.outputs.VTU`."""
    output = gx.outputs.VTU(folder / "film.pvd", film, fields=FIELDS)
    output.open(run)

    def write(time: float) -> None:
        run.system.unknowns.time = time
        output.record(run, True)

    return write


def vtx(run: gx.Simulation, film: gx.Membrane, folder: Path) -> Write:
    """ADIOS2: one element for all functions, so that each triangle has its own points."""
    fields = FieldFunctions(run.system, film, ("displacement", *FIELDS))
    writer = io.VTXWriter(COMM, folder / "film.bp", fields.functions, engine="BP5")

    def write(time: float) -> None:
        fields.update()
        writer.write(time)

    return write


def xdmf(run: gx.Simulation, film: gx.Membrane, folder: Path) -> Write:
    """HDF5 that all ranks write; values of cells as such."""
    points = FieldFunctions(run.system, film, ("displacement",))
    in_cells = FieldFunctions(run.system, film, FIELDS, ("Discontinuous Lagrange", 0))
    file = io.XDMFFile(COMM, folder / "film.xdmf", "w")
    file.write_mesh(film.mesh.domain)

    def write(time: float) -> None:
        for fields in (points, in_cells):
            fields.update()
            for function in fields.functions:
                file.write_function(function, time)

    return write


def vtkhdf(run: gx.Simulation, film: gx.Membrane, folder: Path) -> Write:
    """The arrays of VTKHDF, without compression: the mesh once, the fields at each time."""
    import h5py

    points = FieldFunctions(run.system, film, ("displacement",))
    in_cells = FieldFunctions(run.system, film, FIELDS, ("Discontinuous Lagrange", 0))
    space = points.functions[0].function_space
    nodes = space.dofmap.index_map.size_local
    topology = space.mesh.topology
    cells = topology.index_map(topology.dim).size_local
    file: Any = h5py.File(folder / "film.vtkhdf", "w") if COMM.rank == 0 else None

    def add(name: str, values: np.ndarray) -> None:
        gathered = COMM.gather(values) or []
        if COMM.rank == 0:
            file[name] = np.concatenate(gathered)

    add("Points", space.tabulate_dof_coordinates()[:nodes])
    add("Connectivity", space.dofmap.index_map.local_to_global(cell_nodes(space)[:cells].ravel()))

    def write(time: float) -> None:
        for fields, count in ((points, 3 * nodes), (in_cells, cells)):
            fields.update()
            for function in fields.functions:
                add(f"{function.name} {time}", function.x.array[:count])
        if COMM.rank == 0:
            file.flush()

    return write


def size_of(folder: Path) -> int:
    """Bytes of all files in a folder, as rank 0 sees them."""
    COMM.barrier()
    return COMM.bcast(sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()))


def measure(
    start: Callable[[gx.Simulation, gx.Membrane, Path], Write],
    run: gx.Simulation,
    film: gx.Membrane,
) -> list[float]:
    """Seconds of a record, bytes of a record, and bytes that are written once."""
    folder = Path(COMM.bcast(tempfile.mkdtemp() if COMM.rank == 0 else ""))
    write = start(run, film, folder)
    write(0.0)
    first = size_of(folder)
    begun = time.perf_counter()
    for record in range(1, RECORDS):
        write(float(record))
    seconds = (time.perf_counter() - begun) / (RECORDS - 1)
    a_record = (size_of(folder) - first) / (RECORDS - 1)
    # Closes the files, which ADIOS2 must find.
    del write
    COMM.barrier()
    if COMM.rank == 0:
        shutil.rmtree(folder)
    return [COMM.allreduce(seconds, MPI.MAX), a_record, first - a_record]


def main() -> None:
    """Print the table of all formats whose libraries are at hand."""
    cells = USUAL_CELLS
    if len(sys.argv) > 1:
        cells = int(sys.argv[1])
    run, film = film_run(cells)
    formats = {"VTU": vtu, "XDMF with HDF5": xdmf}
    if has_adios2:
        formats["VTX"] = vtx
    try:
        import h5py  # noqa: F401
    except ImportError:
        pass
    else:
        formats["VTKHDF by h5py"] = vtkhdf
    if COMM.rank == 0:
        print("| format | s a record | MB a record | MB once |\n|---|---|---|---|")
    for name, start in formats.items():
        seconds, a_record, once = measure(start, run, film)
        if COMM.rank == 0:
            print(f"| {name} | {seconds:.2f} | {a_record / 1e6:.1f} | {once / 1e6:.1f} |")


if __name__ == "__main__":
    main()
