"""Fold lines on a mesh: its edges at which a fold map has a kink, by groups of one angle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from dolfinx import la

from gossamer_fx.algebra import dihedral_angle
from gossamer_fx.checks.errors import check, check_on_all
from gossamer_fx.mesh.mesh import Mesh
from gossamer_fx.model.body import Array, Indices

ISOMETRIC = 1e-6  # strain of a triangle that is on both sides of a fold, at least
FOLDED = 1e-4  # rad: the least angle of a fold
SHEETS = ("top", "bottom")
_ENDS = np.array([[1, 2], [2, 0], [0, 1]])  # vertices from and to which a triangle passes its edges
Key = tuple[int, int, int, float]  # number of the fold, sheet, sense, angle


class Map(Protocol):
    """What is asked of a fold map."""

    called: ClassVar[str]

    def place(self, X: Array, side: Array) -> Array: ...

    def pressed(self) -> Map: ...

    def ajar(self) -> Map: ...

    def label(self, X: Array) -> Indices: ...


@dataclass(frozen=True)
class FoldLine:
    """Edges with one angle [rad], positive for a valley: `name` of the group, local `edges` (owned and ghost)."""

    name: str
    angle: float
    edges: Indices


def find_lines(folds: Map, mesh: Mesh) -> list[FoldLine]:
    """The fold lines of a map on a mesh, in the order of their names; collective.

    Raises:
        InputError: no plane triangles, or some that lie on both sides of a fold line.
    """
    domain, who = mesh.domain, folds.called
    check(
        domain.topology.dim == 2 and domain.geometry.cmap.degree == 1,
        f"{who}: the mesh has no plane triangles; mesh the flat film with triangles of order 1.",
    )
    X = domain.geometry.x
    flat = np.abs(X[:, 2]).max(initial=0.0) <= 1e-9 * max(np.abs(X).max(initial=0.0), 1e-30)
    check(
        mesh.comm.allreduce(int(not flat)) == 0,
        f"{who}: the mesh is not flat; mesh the film in the plane z = 0.",
    )
    corners = domain.geometry.dofmap[:, :3]
    shut, ajar = (
        each.place(X, np.zeros(len(X))) for each in (folds.pressed(), folds.ajar().pressed())
    )
    check_on_all(
        mesh.comm,
        bool(np.isfinite(shut).all() and np.isfinite(ajar).all()),
        f"{who}: nodes of the mesh lie where the map folds nothing, as within its hub; mesh the film of the map.",
    )
    _refuse_cut_triangles(folds, mesh, X[corners], shut[corners])

    table = mesh.edges
    inside = np.flatnonzero(table.is_inside[: table.owned] & table.is_known[: table.owned])
    cells, sides = table.cells[inside], table.sides[inside]
    size, sense = np.abs(_angles(shut, corners, cells, sides)), _angles(ajar, corners, cells, sides)
    sheet = _sheets(mesh)[cells]
    seam = (sheet[:, 0] != sheet[:, 1]) & (sheet > 0).all(axis=1)
    kinked = (np.abs(sense) > FOLDED) & (size > FOLDED) & ~seam
    ends = corners[cells[:, 0, None], _ENDS[sides[:, 0]]]
    number = folds.label(X[ends].mean(axis=1))
    keys: list[Key] = [
        (int(n), int(s), 1 if t > 0 else -1, round(float(a), 5))
        for n, s, t, a in zip(
            number[kinked], sheet[kinked, 0], sense[kinked], size[kinked], strict=True
        )
    ]
    known = sorted({key for part in mesh.comm.allgather(sorted(set(keys))) for key in part})
    code = la.vector(domain.topology.index_map(1))
    code.array[inside[kinked]] = [known.index(key) + 1 for key in keys]
    code.scatter_forward()
    names = _names(known)
    return [
        FoldLine(
            names[key],
            key[2] * key[3],
            np.flatnonzero(np.rint(code.array) == i + 1).astype(np.int32),
        )
        for i, key in enumerate(known)
    ]


def _refuse_cut_triangles(folds: Map, mesh: Mesh, flat: Array, folded: Array) -> None:
    """Those of which an edge changes its length."""
    owned = mesh.domain.topology.index_map(2).size_local
    before, after = (
        np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        for corners in (flat[:owned], folded[:owned])
    )
    cut = np.flatnonzero((np.abs(after - before) > ISOMETRIC * before).any(axis=1))
    count = mesh.comm.allreduce(len(cut))
    places = mesh.comm.allgather(flat[cut[:1]].mean(axis=1).tolist())
    where = next((f"({p[0][0]:.4g}, {p[0][1]:.4g}) m" for p in places if p), "")
    check(
        count == 0,
        f"{folds.called}: {count} triangles lie on both sides of a fold line, one of them at {where}; mesh the film "
        "with edges along its fold lines.",
    )


def _angles(x: Array, corners: Indices, cells: Indices, sides: Indices) -> Array:
    """Signed fold angles (n,) of edges with triangles `cells` (n, 2) on the left and right, at positions x."""
    n = np.arange(len(cells))
    T = x[corners[cells]]  # (n, 2, 3, 3)
    ends = _ENDS[sides[:, 0]]
    t = T[n, 0, ends[:, 1]] - T[n, 0, ends[:, 0]]
    t /= np.linalg.norm(t, axis=1)[:, None]
    away = [T[n, i, sides[:, i]] - T[n, i, _ENDS[sides[:, i], 0]] for i in range(2)]
    inwards = [a - np.einsum("nc,nc->n", a, t)[:, None] * t for a in away]
    vectors: Any = np.stack([t, *inwards], axis=1)
    return np.asarray(dihedral_angle.angle(vectors))


def _sheets(mesh: Mesh) -> Indices:
    """1 and 2 in cells (n,) of the groups "top" and "bottom", 0 elsewhere, and where there is one sheet only."""
    index_map = mesh.domain.topology.index_map(2)
    sheet = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    if all(mesh.groups.get(name, (0,))[0] == 2 for name in SHEETS):
        for k, name in enumerate(SHEETS):
            sheet[mesh.groups[name][1]] = k + 1
    return sheet


def _names(keys: list[Key]) -> dict[Key, str]:
    """Of folds with numbers "fold 1", of others "valley" or "mountain"; the sheet; a number of angles, if several."""
    plain: dict[str, list[Key]] = {}
    for key in keys:
        number, sheet, sense, _ = key
        word = f"fold {number}" if number else ("valley" if sense > 0 else "mountain")
        plain.setdefault(f"{word} {SHEETS[sheet - 1]}" if sheet else word, []).append(key)
    names = {}
    for word, same in plain.items():
        for i, key in enumerate(sorted(same, key=lambda key: -key[3])):
            names[key] = word if len(same) == 1 else f"{word} {i + 1}"
    return names
