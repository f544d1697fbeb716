"""Extraction of a mesh from gmsh as arrays, in a separate process.

gmsh hangs on some geometry, where no signal handler of Python runs, and on some damaged files it
ends the program.  So it works in a child process, a fork of this one, which returns the arrays or
one sentence about what is wrong, and which a time limit or Ctrl-C ends.

gmsh executes any file that it does not recognise as a mesh, and its geometry scripts may run system
commands.  So only files that begin as MSH files do are given to gmsh, under a name that ends in
.msh.

Nothing in this module needs MPI.
"""

from __future__ import annotations

import os
import pickle
import re
import resource
import select
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.checks.ending import end_with_parent
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.checks.strange_files import open_file
from gossamer_fx.core.mesh.quality import NO_SIZE, cell_quality

Integers = npt.NDArray[np.int64]

# Kind and order of gmsh's types of elements.
_KINDS = {
    1: ("interval", 1),
    8: ("interval", 2),
    2: ("triangle", 1),
    9: ("triangle", 2),
}

# Largest coordinate [m].  Checks of the mesh compute squares, which must not overflow.
_FARTHEST = 1e100

# Largest round-off of coordinates over the size of the smallest cell: an error of its strains.
_ROUND_OFF = 1e-6

# Seconds after which gmsh is ended: a million triangles take it 20 s.
TIME_LIMIT = 120.0

# Signals of a crash in the fork: it ends alone, where handlers of PETSc that it has inherited would
# print a trace and abort the ranks.
CRASHES = (signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGABRT)

# Bytes at the beginning of a file that are searched for the format.
_HEAD = 200

# The first two lines of an MSH file: the version, 0 for text or 1 for binary, bytes of a number.
_MSH = re.compile(rb"\$MeshFormat[ \t]*\r?\n[ \t]*(2\.2|4|4\.[0-9])[ \t]+[01][ \t]+8[ \t]*\r?\n")


# What gmsh says of an STL file.
_DROPPED = re.compile(r"(\d+) duplicate/(\d+) degenerate triangles")

# Most cells of a mesh that is made here: more than the solver takes on any machine of today.
MAX_CELLS = 20_000_000

# Bytes that are read from a pipe at once.
_CHUNK = 1 << 20


class BadMesh(ValueError):
    """The mesh cannot be used; the message is a sentence for the user."""


@dataclass(frozen=True)
class RawMesh:
    """Arrays of a mesh whose cells are all of one kind and order, with the node order of gmsh.

    Attributes:
        kind: "interval" or "triangle".
        order: polynomial order of the cells, 1 or 2.
        points: node coordinates (n, 3) [m].
        cells: rows of `points` (m, nodes) at the nodes of each cell.
        groups: for each named group its dimension, and rows of `points` (k, nodes) at the nodes of
            its entities.
        dropped: number of triangles that gmsh has left out of files that it was given.
    """

    kind: str
    order: int
    points: npt.NDArray[np.float64]
    cells: Integers
    groups: dict[str, tuple[int, Integers]]
    dropped: int = 0


def dropped_triangles() -> int:
    """Number of triangles of STL files that gmsh has left out since its logger was started, as they
    were there twice or had no area."""
    import gmsh

    count = 0
    for line in gmsh.logger.get():
        found = _DROPPED.search(line)
        if found is not None:
            count += int(found[1]) + int(found[2])
    return count


def extract(model: Any) -> RawMesh:
    """The mesh of a `gmsh.model`, with its named groups.

    Cells are the elements of the highest dimension; if named groups of this dimension exist, only
    the elements in these groups.  Only nodes of cells become points, numbered in rising order of
    their tags.  A model without elements or with several kinds, cells that coincide, nodes that are
    missing or not finite, cells of no size, and cells so far from the origin that their strains
    would have a round-off above 1e-6 raise `BadMesh`.
    """
    tags, coordinates, _ = model.mesh.getNodes()
    tags = np.asarray(tags, dtype=np.int64)
    # d is the dimension of an entity of the geometry: 0 to 3.
    dimensions = {d for d, _ in model.getEntities()}
    meshed = [d for d in dimensions if model.mesh.getElements(d)[0].size]
    dim = max(meshed, default=0)
    _check(dim > 0, "The mesh has no triangles or line elements; mesh a surface or a curve.")
    _check(
        dim < 3, "The mesh fills a volume; mesh surfaces or curves only, e.g. by mesh.generate(2)."
    )
    kind, order = _kind_and_order(model, dim)

    cells = _cells(model, dim)
    used = np.unique(cells)
    _check(
        bool(np.isin(used, tags).all()),
        "Cells of the mesh have nodes that it does not list; write it again.",
    )
    twice = _repeated_node(cells)
    _check(
        twice is None,
        f"A cell of the mesh has the node {twice} twice; remove it, or write the mesh again.",
    )
    _check(
        len(np.unique(np.sort(cells, axis=1), axis=0)) == len(cells),
        "Two cells of the mesh have the same nodes: "
        "a file of version 2.2 has cells twice that are in two physical groups, "
        "so save it as version 4.1; where two sheets meet at a corner, "
        "choose the triangles so that each has a separate node.",
    )

    # Only the nodes of cells become points, in rising order of their tags.
    order_of_tags = np.argsort(tags)
    rows = order_of_tags[np.searchsorted(tags, used, sorter=order_of_tags)]
    points = coordinates.reshape(-1, 3)[rows]
    is_usual = (abs(points) < _FARTHEST).all(axis=1)
    wrong = int(is_usual.argmin())
    _check(
        bool(is_usual.all()),
        f"The node {used[wrong]} of the mesh is at {points[wrong].tolist()} m, which are not all "
        f"numbers below {_FARTHEST:g}; mesh it again.",
    )
    cells = np.searchsorted(used, cells)
    sizes = np.ptp(points[cells], axis=1).max(axis=1)
    farthest = float(np.abs(points).max())
    smallest = float(sizes[sizes > 0].min(initial=np.inf))
    _check(
        np.spacing(farthest) <= _ROUND_OFF * smallest,
        f"Cells of {smallest:.3g} m are up to {farthest:.3g} m from the origin, where coordinates "
        f"are {np.spacing(farthest):.1g} m apart; move the mesh to the origin.",
    )
    groups = _groups(model, dim, used)
    _check_quality(points[cells[:, : dim + 1]], cells, groups)
    return RawMesh(kind=kind, order=order, points=points, cells=cells, groups=groups)


def _check_quality(
    corners: npt.NDArray[np.float64], cells: Integers, groups: dict[str, tuple[int, Integers]]
) -> None:
    """Refuse a mesh with a cell of no size; the message says where it is, and in which group.

    Args:
        corners: of the cells (m, 2 or 3, 3) [m].
        cells: rows of the points (m, nodes).
        groups: see `RawMesh`.
    """
    extent = float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)))
    flat = np.flatnonzero(cell_quality(corners, extent) < NO_SIZE)
    if not len(flat):
        return
    first = cells[flat[0]]
    names = [
        f"'{name}'"
        for name, (dim, nodes) in groups.items()
        if dim == corners.shape[1] - 1 and (nodes == first).all(axis=1).any()
    ]
    kind = "triangle" if corners.shape[1] == 3 else "line element"
    where = ", ".join(f"{x:.6g}" for x in corners[flat[0], 0])
    group = f" of the group {names[0]}" if names else ""
    raise BadMesh(
        f"The mesh has {len(flat)} {kind}{'s' * (len(flat) > 1)} of no size, the nodes of which "
        f"are at one point or on a line, one{group} at ({where}) m; mesh it again, or remove "
        "duplicate nodes (gmsh: model.mesh.removeDuplicateNodes)."
    )


def check_cells(what: str, cells: float) -> None:
    """Raise `InputError` if a mesh that is to be made would have more than `MAX_CELLS` cells, by an
    estimate of their number; `what` begins the message."""
    check(
        cells <= MAX_CELLS,
        f"{what} has about {cells:.2g} cells; give larger ones, at most {MAX_CELLS:g} in all.",
    )


def _kind_and_order(model: Any, dim: int) -> tuple[str, int]:
    """Kind and order of the elements of a dimension, which must all be of one type."""
    types = set(model.mesh.getElementTypes(dim))
    names = " and ".join(sorted(model.mesh.getElementProperties(t)[0] for t in types))
    _check(
        len(types) == 1 and types <= set(_KINDS),
        f"The mesh is made of {names}; use triangles (or line elements) of one order, 1 or 2.",
    )
    # gmsh hands over the triangles of one order of each surface, and leaves out the others.
    given = sum(len(tags) for tags in model.mesh.getElements(dim)[1])
    import gmsh

    _check(
        dim != 2 or int(gmsh.option.getNumber("Mesh.NbTriangles")) == given,
        "The mesh has triangles of both orders on one surface; use one order, 1 or 2.",
    )
    return _KINDS[types.pop()]


def _tagged(model: Any, dim: int) -> list[tuple[int, int]]:
    """Dimension and number of the physical groups up to a dimension."""
    return [(d, group) for d, group in model.getPhysicalGroups() if d <= dim]


def _cells(model: Any, dim: int) -> Integers:
    """Tags (m, nodes), gmsh's numbers, of the nodes of all cells: of the elements in named groups
    of the dimension if there are any, else of all.  `BadMesh`: the groups hold no cell, or elements
    of several kinds."""
    surfaces = set()
    # d is the dimension of a group.
    for d, group in _tagged(model, dim):
        if d == dim:
            surfaces.update(model.getEntitiesForPhysicalGroup(d, group))
    # Without named groups all elements are cells.
    chosen = sorted(surfaces) or [entity for _, entity in model.getEntities(dim)]
    found = []
    for entity in chosen:
        elements = _elements(model, dim, entity)
        if len(elements):
            found.append(elements)
    _check(
        bool(found),
        "The named groups of the mesh hold none of its cells; name the surfaces that are meant.",
    )
    return np.vstack(found)


def _groups(model: Any, dim: int, used: Integers) -> dict[str, tuple[int, Integers]]:
    """Dimension and rows (k, nodes) of the points of each entity of the named groups, by name; a
    group without a name has its number.

    `used` are the tags (n,) of the points in rising order.  Entities that belong to no cell are
    left out.  `BadMesh`: an entity has one node twice, or a group elements of several kinds.
    """
    groups = {}
    # d is the dimension of a group.
    for d, group in _tagged(model, dim):
        entities = [_elements(model, d, e) for e in model.getEntitiesForPhysicalGroup(d, group)]
        not_empty = [nodes for nodes in entities if len(nodes)]
        nodes = np.vstack(not_empty or [np.zeros((0, d + 1), dtype=np.int64)])
        # Entities that belong to no cell are left out.
        nodes = nodes[np.isin(nodes, used).all(axis=1)]
        name = model.getPhysicalName(d, group) or str(group)
        twice = _repeated_node(nodes)
        _check(
            twice is None,
            f"An element of the group '{name}' has the node {twice} twice; write the mesh again.",
        )
        _check(
            name not in groups,
            f"The mesh has two groups '{name}', of points, curves or surfaces; give each its name.",
        )
        groups[name] = d, np.searchsorted(used, nodes)
    return groups


def _elements(model: Any, dim: int, entity: int) -> Integers:
    """Tags (n, nodes per element) of the nodes of all elements of one geometric entity."""
    kinds, _, nodes = model.mesh.getElements(dim, entity)
    if not len(kinds):
        return np.zeros((0, dim + 1), dtype=np.int64)
    _check(len(kinds) == 1, "A group of the mesh holds elements of several kinds; use one kind.")
    width = model.mesh.getElementProperties(kinds[0])[3]
    return np.asarray(nodes[0], dtype=np.int64).reshape(-1, width)


def _repeated_node(entities: Integers) -> int | None:
    """A node that an entity (a row) has twice, on which dolfinx crashes; None without one."""
    nodes = np.sort(entities, axis=1)
    repeated = nodes[:, 1:][nodes[:, 1:] == nodes[:, :-1]]
    return int(repeated[0]) if len(repeated) else None


def _check(condition: bool, message: str) -> None:
    """Raise `BadMesh` with the message unless the condition holds."""
    if not condition:
        raise BadMesh(message)


# ---- child processes -----------------------------------------------------------------------------


def in_child(build: Callable[[], RawMesh], what: str, time_limit: float) -> RawMesh:
    """Return the mesh that a function builds with gmsh in a fork of this process.

    Args:
        build: may raise `BadMesh`; of what it changes only files remain.
        what: the work of gmsh in messages, "the mesh of ...".
        time_limit: [s].

    Raises:
        BadMesh: what `build` raises, in one sentence and with its traceback as a note; gmsh breaks
            off, or takes more than the time limit.
    """
    # Loaded here, so that forks need not do it again.
    import gmsh  # noqa: F401

    reader, writer = os.pipe()
    # Else the child would write again what is buffered.
    sys.stdout.flush()
    sys.stderr.flush()
    with warnings.catch_warnings():
        # Python warns of threads, which are those of the linear algebra; they are idle.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if not child:
        _answer(build, what, writer)
    os.close(writer)
    # Also Ctrl-C ends the child, here or by its own signal.
    try:
        answer = _received(reader, what, time_limit)
    finally:
        os.close(reader)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    if isinstance(answer, RawMesh):
        return answer
    words, trace = answer
    error = BadMesh(words)
    error.add_note(trace)
    raise error


def _answer(build: Callable[[], RawMesh], what: str, pipe: int) -> NoReturn:
    """Send the mesh, or a sentence and a traceback, through a pipe, and end this fork."""
    try:
        end_with_parent()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, *CRASHES):
            signal.signal(number, signal.SIG_DFL)
        _limit_memory()
        answer: RawMesh | tuple[str, str]
        try:
            answer = build()
        except BaseException as error:
            answer = _sentence(error, what), traceback.format_exc()
        with os.fdopen(pipe, "wb") as file:
            pickle.dump(answer, file, pickle.HIGHEST_PROTOCOL)
        sys.stdout.flush()
    finally:
        # Handlers of this process's end, such as those of MPI, belong to its parent.
        os._exit(0)


def _limit_memory() -> None:
    """Let this process fail alone when it takes half of the memory, not the machine."""
    if sys.platform != "linux":
        return
    page = os.sysconf("SC_PAGE_SIZE")
    pages_used = int(Path("/proc/self/statm").read_text().split()[0])
    limit = page * (pages_used + os.sysconf("SC_PHYS_PAGES") // 2)
    _, allowed = resource.getrlimit(resource.RLIMIT_AS)
    if allowed == resource.RLIM_INFINITY or limit < allowed:
        resource.setrlimit(resource.RLIMIT_AS, (limit, allowed))


def _sentence(error: BaseException, what: str) -> str:
    """What is wrong, in one sentence, by an error that was raised while gmsh made `what`."""
    # Messages of the package's errors are sentences already.
    if isinstance(error, ValueError) and type(error).__module__.startswith("gossamer_fx."):
        return str(error)
    # gmsh has no words when memory runs out.
    words = " ".join(str(error).split()) or "no words, as when memory runs out"
    return f"{what} cannot be made: {type(error).__name__} ({words}); correct it."


def _received(pipe: int, what: str, time_limit: float) -> RawMesh | tuple[str, str]:
    """What a child process sends, a mesh or a sentence and a traceback; `BadMesh`: it ends without
    an answer, or has none within the time limit [s]."""
    deadline = time.monotonic() + time_limit
    received = bytearray()
    while True:
        remaining = deadline - time.monotonic()
        is_ready = select.select([pipe], [], [], max(remaining, 0.0))[0]
        _check(
            bool(is_ready),
            f"{what} was not made within {time_limit:g} s; look for outlines that cross or for "
            "cells that are too small, or give a larger time_limit.",
        )
        part = os.read(pipe, _CHUNK)
        if not part:
            break
        received += part
    _check(
        bool(received),
        f"gmsh broke off at {what[0].lower()}{what[1:]}; correct its geometry, or write a file "
        "again as MSH 4.1.",
    )
    return pickle.loads(received)


# ---- files ---------------------------------------------------------------------------------------


def read_file(path: Path, time_limit: float = TIME_LIMIT) -> RawMesh:
    """Read a mesh, in m, from a file in MSH format, version 2.2 or 4.x, in a child process of this
    rank, which takes at most `time_limit` [s].

    A file that cannot be read, is in another format, on which gmsh fails or whose mesh `extract`
    refuses raises `BadMesh` with a sentence for the user.
    """
    _check_format(path)
    with tempfile.TemporaryDirectory() as folder:
        # gmsh decides by the suffix before it looks into a file, and reads options from files next
        # to it; so it gets the file in an empty folder and with the right suffix.
        link = Path(folder) / "mesh.msh"
        link.symlink_to(path.resolve())

        def read() -> RawMesh:
            import gmsh

            gmsh.initialize(readConfigFiles=False, interruptible=False)
            gmsh.option.setNumber("General.Terminal", 0)
            gmsh.merge(str(link))
            return extract(gmsh.model)

        return in_child(read, f"The mesh of the file '{path}'", time_limit)


def _check_format(path: Path) -> None:
    """Raise `BadMesh` unless a file can be opened and begins as one in MSH format 2.2 or 4.x
    does."""
    try:
        with open_file(path) as file:
            head = file.read(_HEAD)
    except OSError as error:
        raise BadMesh(
            f"'{path}' cannot be read ({error.strerror}); give a mesh file that is readable."
        ) from error
    except InputError as error:
        raise BadMesh(str(error)) from error
    _check(
        _MSH.match(head) is not None,
        f"'{path}' is not in MSH format 2.2 or 4.x; "
        "write the mesh with gmsh as MSH 4.1 (gmsh -format msh41).",
    )
