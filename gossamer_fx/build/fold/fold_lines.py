"""Fold lines on a mesh: its edges at which a fold map has a kink, in groups of one angle.

Algorithm, for a fold map and a mesh of the flat film:

1. Place the vertices by the map with all layers on each other (`pressed`).  A triangle whose edges
   change their length lies on both sides of a fold line; such a mesh is refused.
2. The dihedral angle at each edge inside the mesh gives the size of its fold.  Its sign cannot be
   read there, as a fold that is shut has ±π; it comes from a second placement, of the map with no
   fold shut (`ajar`).
3. Sort the kinked edges into groups: by number of the fold, sheet, sign and angle.
4. Exchange the groups of edges with the ranks that have them as ghosts.

Cost: two placements and angles of all edges, once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from dolfinx import la

from gossamer_fx.core.algebra import dihedral_angle
from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.forms.backend import geometry_element, geometry_nodes
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.mesh.quality import box
from gossamer_fx.core.model.body import Array, Indices

# Strain of an edge from which a triangle lies on both sides of a fold line; round-off of a map is
# 1e-9 at most.
MIN_STRAIN = 1e-6

# Smallest angle [rad] of a fold
MIN_ANGLE = 1e-4

# Decimals of an angle [rad] by which edges are sorted into groups: ranks compute with different
# round-off.
ANGLE_DECIMALS = 5

# Height of the vertices over the size of the mesh up to which a mesh is flat
FLATNESS = 1e-9

# Groups of a mesh with two sheets, the upper one first
SHEETS = ("top", "bottom")

# Corners from and to which a triangle passes its edges, counter-clockwise
_EDGE_ENDS = np.array([[1, 2], [2, 0], [0, 1]])


class Map(Protocol):
    """The part of a fold map that this module uses; see `fold_map.FoldMap`."""

    called: ClassVar[str]

    def place(self, X: Array, side: Array) -> Array:
        """Folded positions (n, 3) [m] of points X (n, 3) on sheets `side` (n,)."""

    def pressed(self) -> Map:
        """The same folds without any distance of layers."""

    def ajar(self) -> Map:
        """The same folds with no fold shut."""

    def check_fits(self, low: Array, high: Array) -> None:
        """Raise `InputError` unless the map is for a film from `low` to `high` (3,) [m]."""

    def label(self, X: Array) -> Indices:
        """Number of the fold at points X (n, 3); 0 if folds have no numbers."""


class Key(NamedTuple):
    """What edges of one fold line have in common: the number of the fold, or 0; the sheet (1 "top",
    2 "bottom", 0 for a film of one sheet); 1 for a valley, -1 for a mountain; and the size of the
    angle [rad]."""

    fold: int
    sheet: int
    sign: int
    angle: float


@dataclass(frozen=True)
class FoldLine:
    """Edges of a mesh with one fold angle [rad], positive for a valley: local numbers, owned and
    ghost, in rising order, and the name of their group."""

    name: str
    angle: float
    edges: Indices


def find_lines(folds: Map, mesh: Mesh) -> list[FoldLine]:
    """Return the fold lines of a map on a mesh of the flat film, in an order that is the same on
    every rank.  Collective.

    X (n, 3) [m] are the points of the mesh on this rank, ghosts included; `shut` and `ajar` are
    their positions [m] on the closed map and on the map that is opened a little.  A mesh that
    `pressed_positions` refuses raises `InputError`.
    """
    domain = mesh.domain
    shut = pressed_positions(folds, mesh)
    X = domain.geometry.x
    ajar = folds.pressed().ajar().place(X, np.zeros(len(X)))
    # Steps 2 and 3
    edges, keys = _kinked_edges(folds, mesh, shut, ajar)
    of_ranks = mesh.comm.allgather(sorted(set(keys)))
    known = sorted({key for part in of_ranks for key in part})
    # Step 4: a number for each edge of a fold line, 0 for all others
    numbers = la.vector(domain.topology.index_map(1))
    numbers.array[edges] = [known.index(key) + 1 for key in keys]
    numbers.scatter_forward()
    of_edges = np.rint(numbers.array)
    names = _names(known)
    lines = []
    for i, key in enumerate(known):
        line = FoldLine(
            name=names[key],
            angle=key.sign * key.angle,
            edges=np.flatnonzero(of_edges == i + 1).astype(np.int32),
        )
        lines.append(line)
    return lines


def pressed_positions(folds: Map, mesh: Mesh) -> Array:
    """Positions (n, 3) [m] of this rank's points, ghosts included, with all layers on each other,
    step 1 of the module; `InputError`: a triangle is not folded without strain.  Collective."""
    _check_mesh(folds, mesh)
    X = mesh.domain.geometry.x
    corners = geometry_nodes(mesh.domain)[:, :3]
    shut = folds.pressed().place(X, np.zeros(len(X)))
    check_on_all(
        mesh.comm,
        bool(np.isfinite(shut).all()),
        f"{folds.called}: nodes of the mesh lie where the map folds nothing, as within its hub; "
        "mesh the film of the map.",
    )
    _refuse_cut_triangles(folds, mesh, X[corners], shut[corners])
    return shut


def has_two_sheets(mesh: Mesh) -> bool:
    """Whether a mesh has both groups of `SHEETS`, of triangles."""
    return all(name in mesh.groups and mesh.groups[name][0] == 2 for name in SHEETS)


def _check_mesh(folds: Map, mesh: Mesh) -> None:
    """Raise `InputError` on all ranks unless a mesh has triangles of order 1 in the plane z = 0, in
    the extent of a fold map.  Collective."""
    domain = mesh.domain
    check(
        domain.topology.dim == 2 and geometry_element(domain).degree == 1,
        f"{folds.called}: the mesh has no plane triangles; "
        "mesh the flat film with triangles of order 1.",
    )
    # Coordinates (n, 3) [m] of this rank's points, ghosts included
    X = domain.geometry.x
    height = np.abs(X[:, 2]).max(initial=0.0)
    size = np.abs(X).max(initial=0.0)
    # A rank without nodes has the height and the size zero, and is flat.
    flat = height <= FLATNESS * size
    check(
        mesh.comm.allreduce(int(not flat)) == 0,
        f"{folds.called}: the mesh is not flat; mesh the film in the plane z = 0.",
    )
    folds.check_fits(*box(mesh.comm, X))


def _kinked_edges(folds: Map, mesh: Mesh, shut: Array, ajar: Array) -> tuple[Indices, list[Key]]:
    """The owned edges at which a fold map has a kink, by their local numbers (k,), and for each the
    number of its fold, its sheet, its sign, and the size of its angle [rad].

    `shut` (n, 3) [m] are the vertices with all layers on each other, folds of ±π included, which
    give the size of each angle; `ajar` those with no fold at ±π, which give the sign.
    """
    corners = geometry_nodes(mesh.domain)[:, :3]
    table = mesh.edges
    is_inside = table.is_inside[: table.owned] & table.is_known[: table.owned]
    inside: Indices = np.flatnonzero(is_inside).astype(np.int32)
    cells = table.cells[inside]
    sides = table.sides[inside]
    size = np.abs(_angles(shut, corners, cells, sides))
    signed = _angles(ajar, corners, cells, sides)
    sheet = _sheets(mesh)[cells]
    # Two sheets are joined at a seam, which is not a fold.
    seam = (sheet[:, 0] != sheet[:, 1]) & (sheet > 0).all(axis=1)
    kinked = np.flatnonzero((np.abs(signed) > MIN_ANGLE) & (size > MIN_ANGLE) & ~seam)
    ends = corners[cells[:, 0, None], _EDGE_ENDS[sides[:, 0]]]
    middles = mesh.domain.geometry.x[ends].mean(axis=1)
    fold = folds.label(middles)
    keys = []
    for k in kinked:
        key = Key(
            fold=int(fold[k]),
            sheet=int(sheet[k, 0]),
            sign=int(np.sign(signed[k])),
            angle=round(float(size[k]), ANGLE_DECIMALS),
        )
        keys.append(key)
    return inside[kinked], keys


def _refuse_cut_triangles(folds: Map, mesh: Mesh, flat: Array, folded: Array) -> None:
    """Raise `InputError` on all ranks if an edge of a triangle changes its length from the flat to
    the folded corners (triangles, 3, 3) [m].  Collective."""
    owned = mesh.domain.topology.index_map(2).size_local
    before = _edge_lengths(flat[:owned])
    after = _edge_lengths(folded[:owned])
    strained = np.abs(after - before) > MIN_STRAIN * before
    cut = np.flatnonzero(strained.any(axis=1))
    count = mesh.comm.allreduce(len(cut))
    centres = mesh.comm.allgather(flat[cut[:1]].mean(axis=1).tolist())
    where = ""
    for of_rank in centres:
        if of_rank and not where:
            x, y, _ = of_rank[0]
            where = f"({x:.4g}, {y:.4g}) m"
    check(
        count == 0,
        f"{folds.called}: {count} triangles lie on both sides of a fold line, "
        f"one of them at {where}; mesh the film with edges along its fold lines.",
    )


def _edge_lengths(corners: Array) -> Array:
    """Lengths (n, 3) [m] of the edges of triangles with corners (n, 3, 3)."""
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)


def _angles(x: Array, corners: Indices, cells: Indices, sides: Indices) -> Array:
    """Fold angles (n,) [rad] of edges, between -π and π, zero if flat, positive for a valley.

    x (v, 3) [m] are the vertices and `corners` (triangles, 3) their numbers in all triangles;
    `cells` (n, 2) are the triangles on the left and right of each edge, `sides` (n, 2) the number
    of the edge in them, that of the corner opposite.
    """
    n = np.arange(len(cells))
    triangles = x[corners[cells]]  # (n, 2, 3, 3)
    ends = _EDGE_ENDS[sides[:, 0]]
    tangent = triangles[n, 0, ends[:, 1]] - triangles[n, 0, ends[:, 0]]
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    inwards = []
    for i in range(2):
        # The corner of an edge with the same number is opposite to it.
        opposite = triangles[n, i, sides[:, i]]
        on_edge = triangles[n, i, _EDGE_ENDS[sides[:, i], 0]]
        away = opposite - on_edge
        along = np.einsum("nc,nc->n", away, tangent)
        inwards.append(away - along[:, None] * tangent)
    vectors: Any = np.stack([tangent, *inwards], axis=1)
    return np.asarray(dihedral_angle.angle(vectors))


def _sheets(mesh: Mesh) -> Indices:
    """Return the sheet of each local cell (n,), ghosts included: 1 for "top", 2 for "bottom"."""
    index_map = mesh.domain.topology.index_map(2)
    sheet = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    if has_two_sheets(mesh):
        for k, name in enumerate(SHEETS):
            _, cells = mesh.groups[name]
            sheet[cells] = k + 1
    return sheet


def _names(keys: list[Key]) -> dict[Key, str]:
    """Return names of fold lines, e.g. "fold 1", "valley", "fold 1 top"; where several would have
    one name they are numbered, "valley 1" the sharpest."""
    by_name: dict[str, list[Key]] = {}
    for key in keys:
        by_name.setdefault(_plain_name(key), []).append(key)
    names = {}
    for name, same in by_name.items():
        # The sharpest fold is the first.
        same.sort(key=lambda key: -key.angle)
        for i, key in enumerate(same):
            names[key] = f"{name} {i + 1}"
        if len(same) == 1:
            names[same[0]] = name
    return names


def _plain_name(key: Key) -> str:
    """Return the name of a fold line by its number or sign, and its sheet, e.g. "mountain top"."""
    name = "valley"
    if key.fold:
        name = f"fold {key.fold}"
    elif key.sign < 0:
        name = "mountain"
    if key.sheet:
        name = f"{name} {SHEETS[key.sheet - 1]}"
    return name
