"""What gmsh knows of a mesh, as arrays; a file is read by a process of its own.

gmsh executes what it does not take for a mesh: geometry scripts may run any command.  So only files in MSH format reach
it, under a name that says nothing else.  It also ends the program that it runs in on some damaged files.  So a file is
read by a child, which says in one sentence what is wrong with it, or leaves the arrays in a file.  Nothing here needs
MPI.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Integers = npt.NDArray[np.int64]

_KINDS = {1: ("interval", 1), 8: ("interval", 2), 2: ("triangle", 1), 9: ("triangle", 2)}
_FARTHEST = 1e100  # m; squares of areas must be numbers
_REFUSED = 3  # exit code of a child that has said why
# the first two lines of a file of gmsh 2.2 or 4.x: version, 0 for text or 1 for binary, bytes of a number
_MSH = re.compile(rb"\$MeshFormat[ \t]*\r?\n[ \t]*(2\.2|4|4\.[0-9])[ \t]+[01][ \t]+8[ \t]*\r?\n")


class BadMesh(ValueError):
    """A mesh that cannot be used; the message is a sentence."""


@dataclass(frozen=True)
class RawMesh:
    """Cells of one kind and order (1 or 2) with their points; entities of named groups, all with gmsh's order of nodes.

    points (n, 3), cells (m, nodes), groups: dimension and entities (k, nodes) by name
    """

    kind: str
    order: int
    points: npt.NDArray[np.float64]
    cells: Integers
    groups: dict[str, tuple[int, Integers]]


def extract(model: Any) -> RawMesh:
    """The mesh of a gmsh model: its elements of the highest dimension, those in named groups only if there are any.

    Raises:
        BadMesh: no elements, elements of several kinds, cells that coincide, nodes that are missing or nowhere.
    """
    tags, coordinates, _ = model.mesh.getNodes()
    tags = np.asarray(tags, dtype=np.int64)
    dim = max((d for d, _ in model.getEntities() if model.mesh.getElements(d)[0].size), default=0)
    _check(dim in (1, 2), "The mesh has no triangles or line elements; mesh a surface or a curve.")
    kinds = set(model.mesh.getElementTypes(dim))
    names = " and ".join(sorted(model.mesh.getElementProperties(kind)[0] for kind in kinds))
    _check(
        len(kinds) == 1 and kinds <= set(_KINDS),
        f"The mesh is made of {names}; use triangles (or line elements) of one order, 1 or 2.",
    )
    kind, order = _KINDS[kinds.pop()]
    tagged = [(d, g) for d, g in model.getPhysicalGroups() if d <= dim]
    surfaces = [s for d, g in tagged if d == dim for s in model.getEntitiesForPhysicalGroup(d, g)]
    surfaces = sorted(set(surfaces)) or [s for _, s in model.getEntities(dim)]
    found = [elements for elements in (_elements(model, dim, s) for s in surfaces) if len(elements)]
    _check(
        bool(found),
        "The named groups of the mesh hold none of its cells; name the surfaces that are meant.",
    )
    cells = np.vstack(found)
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
        "Two cells of the mesh have the same nodes: where two sheets meet at a corner, choose the triangles so that "
        "each has a node of its own.",
    )
    order_of_tags = np.argsort(tags)
    points = coordinates.reshape(-1, 3)[
        order_of_tags[np.searchsorted(tags, used, sorter=order_of_tags)]
    ]
    _check(
        bool((abs(points) < _FARTHEST).all()),
        f"Nodes of the mesh have coordinates that are no numbers below {_FARTHEST:g} m; mesh it again.",
    )
    groups = {}
    for d, g in tagged:
        entities = [_elements(model, d, s) for s in model.getEntitiesForPhysicalGroup(d, g)]
        nodes = np.vstack([e for e in entities if len(e)] or [np.zeros((0, d + 1), dtype=np.int64)])
        nodes = nodes[np.isin(nodes, used).all(axis=1)]
        _check(
            not _folded(nodes),
            "Elements of the mesh's groups have one node twice; write the mesh again.",
        )
        groups[model.getPhysicalName(d, g) or str(g)] = d, np.searchsorted(used, nodes)
    return RawMesh(kind, order, points, np.searchsorted(used, cells), groups)


def _elements(model: Any, dim: int, entity: int) -> Integers:
    """Nodes of the elements of one geometric entity, shape (n, nodes per element), gmsh's numbers and order."""
    kinds, _, nodes = model.mesh.getElements(dim, entity)
    if not len(kinds):
        return np.zeros((0, dim + 1), dtype=np.int64)
    _check(len(kinds) == 1, "A group of the mesh holds elements of several kinds; use one kind.")
    width = model.mesh.getElementProperties(kinds[0])[3]
    return np.asarray(nodes[0], dtype=np.int64).reshape(-1, width)


def _folded(entities: Integers) -> bool:
    """Whether some entities have one node twice, at which dolfinx would crash."""
    nodes = np.sort(entities, axis=1)
    return bool((nodes[:, 1:] == nodes[:, :-1]).any())


def _check(condition: bool, message: str) -> None:
    if not condition:
        raise BadMesh(message)


# ---- files ---------------------------------------------------------------------------------------------------------


def read_file(path: Path) -> RawMesh:
    """The mesh in a file of MSH format, version 2.2 or 4.x.

    Raises:
        BadMesh: it is of another format, or what `extract` finds, or what gmsh says, or that gmsh broke off.
    """
    _check_format(path)
    with tempfile.TemporaryDirectory() as folder:
        # gmsh looks at the end of a name before it looks into a file, and for options in files beside it
        arrays, mesh = Path(folder) / "mesh.npz", Path(folder) / "mesh.msh"
        mesh.symlink_to(path.resolve())
        # a child of an MPI process is none itself
        alone = {
            k: v
            for k, v in os.environ.items()
            if not k.startswith(("OMPI_", "PMIX_", "PMI_", "PRTE_"))
        }
        child = subprocess.run(
            [sys.executable, "-m", "gossamer_fx.mesh.gmsh_reader", str(mesh), str(arrays)],
            capture_output=True,
            env=alone,
            stdin=subprocess.DEVNULL,
        )
        said = child.stdout.decode(errors="replace").strip()
        if child.returncode == _REFUSED and said:
            raise BadMesh(said.replace(str(mesh), str(path)))
        if child.returncode or not arrays.is_file():
            raise BadMesh(
                f"gmsh broke off when it read '{path}'; the file is damaged, write it again as MSH 4.1."
            )
        with np.load(arrays) as file:
            about = json.loads(str(file["about"]))
            groups = {name: (d, file[f"group {k}"]) for k, (name, d) in enumerate(about["groups"])}
            return RawMesh(about["kind"], about["order"], file["points"], file["cells"], groups)


def _check_format(path: Path) -> None:
    """Raise `BadMesh` unless the file begins as one in MSH format does."""
    try:
        with path.open("rb") as file:
            head = file.read(200)
    except OSError as error:
        raise BadMesh(
            f"'{path}' cannot be read ({error.strerror}); give a mesh file that is readable."
        ) from error
    _check(
        _MSH.match(head) is not None,
        f"'{path}' is not in MSH format 2.2 or 4.x; write the mesh with gmsh as MSH 4.1 (gmsh -format msh41).",
    )


def _read_here(path: str, arrays: str) -> None:
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    try:
        gmsh.merge(path)
        raw = extract(gmsh.model)
    except BadMesh:
        raise
    except Exception as error:  # gmsh has no other kind; names in a damaged file may be no text
        words = " ".join(str(error).split())
        raise BadMesh(f"gmsh cannot read '{path}' ({words}); write it again as MSH 4.1.") from error
    about = {
        "kind": raw.kind,
        "order": raw.order,
        "groups": [(name, d) for name, (d, _) in raw.groups.items()],
    }
    entities = {f"group {k}": nodes for k, (_, nodes) in enumerate(raw.groups.values())}
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
