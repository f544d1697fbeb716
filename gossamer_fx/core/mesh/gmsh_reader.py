"""Extraction of a mesh from gmsh as arrays, and reading of mesh files in a separate process.

Files are read with two precautions:

1. gmsh executes any file that it does not recognise as a mesh, and its geometry scripts may run
   system commands.  So only files that begin as MSH files do are given to gmsh, under a name that
   ends in .msh.
2. gmsh ends the program in which it runs on some damaged files.  So a child process reads the file.
   It prints one sentence about what is wrong, or writes the arrays to a file.

Nothing in this module needs MPI.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.checks.child_processes import ISOLATED, child_environment

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

# Exit code of the child process after it has printed what is wrong with the file.
_REFUSED = 3

# Bytes at the beginning of a file that are searched for the format.
_HEAD = 200

# Variables of MPI launchers.  A child process that inherits them takes itself for an MPI process.
_LAUNCHER_VARIABLES = ("OMPI_", "PMIX_", "PMI_", "PRTE_")

# The first two lines of an MSH file: the version, 0 for text or 1 for binary, bytes of a number.
_MSH = re.compile(rb"\$MeshFormat[ \t]*\r?\n[ \t]*(2\.2|4|4\.[0-9])[ \t]+[01][ \t]+8[ \t]*\r?\n")


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
    """

    kind: str
    order: int
    points: npt.NDArray[np.float64]
    cells: Integers
    groups: dict[str, tuple[int, Integers]]


def extract(model: Any) -> RawMesh:
    """The mesh of a `gmsh.model`, with its named groups.

    Cells are the elements of the highest dimension; if named groups of this dimension exist, only
    the elements in these groups.  Only nodes of cells become points, numbered in rising order of
    their tags.  A model without elements or with several kinds, cells that coincide, and nodes that
    are missing or not finite raise `BadMesh`.
    """
    tags, coordinates, _ = model.mesh.getNodes()
    tags = np.asarray(tags, dtype=np.int64)
    # d is the dimension of an entity of the geometry: 0 to 3.
    meshed = [d for d, _ in model.getEntities() if model.mesh.getElements(d)[0].size]
    dim = max(meshed, default=0)
    _check(dim in (1, 2), "The mesh has no triangles or line elements; mesh a surface or a curve.")
    kind, order = _kind_and_order(model, dim)

    cells = _cells(model, dim)
    used = np.unique(cells)
    _check(
        bool(np.isin(used, tags).all()),
        "Cells of the mesh have nodes that it does not list; write it again.",
    )
    _check(
        not _folded(cells),
        "Cells of the mesh have one node twice; remove them, or write the mesh again.",
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
    _check(
        bool((abs(points) < _FARTHEST).all()),
        f"Nodes of the mesh have coordinates that are not numbers below {_FARTHEST:g} m; "
        "mesh it again.",
    )
    return RawMesh(
        kind=kind,
        order=order,
        points=points,
        cells=np.searchsorted(used, cells),
        groups=_groups(model, dim, used),
    )


def _kind_and_order(model: Any, dim: int) -> tuple[str, int]:
    """Kind and order of the elements of a dimension, which must all be of one type."""
    types = set(model.mesh.getElementTypes(dim))
    names = " and ".join(sorted(model.mesh.getElementProperties(t)[0] for t in types))
    _check(
        len(types) == 1 and types <= set(_KINDS),
        f"The mesh is made of {names}; use triangles (or line elements) of one order, 1 or 2.",
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
        _check(
            not _folded(nodes),
            "Elements of the mesh's groups have one node twice; write the mesh again.",
        )
        name = model.getPhysicalName(d, group) or str(group)
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


def _folded(entities: Integers) -> bool:
    """Whether an entity (a row) has one node twice; dolfinx crashes on such a mesh."""
    nodes = np.sort(entities, axis=1)
    return bool((nodes[:, 1:] == nodes[:, :-1]).any())


def _check(condition: bool, message: str) -> None:
    """Raise `BadMesh` with the message unless the condition holds."""
    if not condition:
        raise BadMesh(message)


# ---- files ---------------------------------------------------------------------------------------


def read_file(path: Path) -> RawMesh:
    """Read a mesh, in m, from a file in MSH format, version 2.2 or 4.x, in a child process of one
    rank.

    A file that cannot be read, is in another format, on which gmsh fails or whose mesh `extract`
    refuses raises `BadMesh` with a sentence for the user.
    """
    _check_format(path)
    with tempfile.TemporaryDirectory() as folder:
        arrays = Path(folder) / "mesh.npz"
        # gmsh decides by the suffix before it looks into a file, and reads options from files next
        # to it; so it gets the file in an empty folder and with the right suffix.
        mesh = Path(folder) / "mesh.msh"
        mesh.symlink_to(path.resolve())
        environment = {}
        for name, value in child_environment().items():
            if not name.startswith(_LAUNCHER_VARIABLES):
                environment[name] = value
        module = "gossamer_fx.core.mesh.gmsh_reader"
        child = subprocess.run(
            [sys.executable, ISOLATED, "-m", module, str(mesh), str(arrays)],
            capture_output=True,
            env=environment,
            stdin=subprocess.DEVNULL,
        )
        reason = child.stdout.decode(errors="replace").strip()
        if child.returncode == _REFUSED and reason:
            raise BadMesh(reason.replace(str(mesh), str(path)))
        if child.returncode or not arrays.is_file():
            raise BadMesh(
                f"gmsh broke off when it read '{path}'; "
                "the file is damaged, write it again as MSH 4.1."
            )
        return _load(arrays)


def _load(arrays: Path) -> RawMesh:
    """Return the mesh in a file that the child process has written."""
    with np.load(arrays) as file:
        about = json.loads(str(file["about"]))
        groups = {}
        for number, (name, dim) in enumerate(about["groups"]):
            groups[name] = dim, file[f"group {number}"]
        return RawMesh(
            kind=about["kind"],
            order=about["order"],
            points=file["points"],
            cells=file["cells"],
            groups=groups,
        )


def _check_format(path: Path) -> None:
    """Raise `BadMesh` unless a file can be opened and begins as one in MSH format 2.2 or 4.x
    does."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError as error:
        raise BadMesh(
            f"'{path}' cannot be read ({error.strerror}); give a mesh file that is readable."
        ) from error
    _check(
        _MSH.match(head) is not None,
        f"'{path}' is not in MSH format 2.2 or 4.x; "
        "write the mesh with gmsh as MSH 4.1 (gmsh -format msh41).",
    )


def _read_here(path: str, arrays: str) -> None:
    """Read a file with gmsh in this process, and write its mesh to an .npz file: points [m], cells,
    and the nodes of each named group."""
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    try:
        gmsh.merge(path)
        raw = extract(gmsh.model)
    except BadMesh:
        raise
    # gmsh raises plain Exception; names in a damaged file may raise UnicodeDecodeError.
    except Exception as error:
        words = " ".join(str(error).split())
        raise BadMesh(f"gmsh cannot read '{path}' ({words}); write it again as MSH 4.1.") from error
    about = {
        "kind": raw.kind,
        "order": raw.order,
        "groups": [(name, d) for name, (d, _) in raw.groups.items()],
    }
    # Names of groups may contain any character; names inside the file are numbers.
    entities = {}
    for number, (_, nodes) in enumerate(raw.groups.values()):
        entities[f"group {number}"] = nodes
    contents: dict[str, Any] = {
        "about": json.dumps(about),
        "points": raw.points,
        "cells": raw.cells,
        **entities,
    }
    np.savez(arrays, **contents)


if __name__ == "__main__":
    try:
        _read_here(sys.argv[1], sys.argv[2])
    except BadMesh as error:
        print(error)
        sys.exit(_REFUSED)
