"""The table of a mesh's edges: ends, triangles on both sides, groups and nodes, on any number of
ranks."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx import fem
from dolfinx import mesh as dmesh
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.mesh.edges import EdgeTable, edges_of
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import three_sheets

WORLD = MPI.COMM_WORLD


def vertex_points(domain: dmesh.Mesh) -> np.ndarray:
    """Coordinates of the local vertices."""
    topology = domain.topology
    topology.create_connectivity(0, 2)
    n = topology.index_map(0).size_local + topology.index_map(0).num_ghosts
    nodes = dmesh.entities_to_geometry(domain, 0, np.arange(n, dtype=np.int32))
    return domain.geometry.x[nodes[:, 0]]


def owned(table: EdgeTable, of: np.ndarray) -> int:
    return WORLD.allreduce(int(np.count_nonzero(of[: table.owned])))


@pytest.mark.mpi
def test_a_sheet_has_the_edges_that_it_should_have() -> None:
    """n² squares of two triangles: 2n(n + 1) sides and n² diagonals, of which 4n are on the
    boundary."""
    mesh = sheet(WORLD, 5, 5)
    table = mesh.edges
    assert owned(table, np.ones(len(table.count))) == 2 * 5 * 6 + 25
    assert owned(table, table.is_boundary) == 20 and owned(table, table.is_inside) == 65
    assert table.is_known[: table.owned].all()


@pytest.mark.mpi
def test_every_rank_tells_the_same_of_an_edge() -> None:
    """Global ends, number of triangles, and for edges all triangles of which are known those on the
    left and right."""
    table = airbag(WORLD, 1.0, 6).edges
    cells = (
        table.domain.topology.index_map(2)
        .local_to_global(table.cells.clip(0).ravel())
        .reshape(-1, 2)
    )
    cells[table.cells < 0] = -1
    seen: dict[tuple[int, int], tuple[int, list[int]]] = {}
    rows = list(
        zip(table.ends.tolist(), table.count.tolist(), cells.tolist(), table.is_known, strict=True)
    )
    for part in WORLD.allgather(rows):
        for ends, count, pair, known in part:
            assert ends[0] < ends[1]
            if known:
                assert seen.setdefault(tuple(ends), (count, pair)) == (count, pair)
    assert len(seen) == owned(table, np.ones(len(table.count)))


@pytest.mark.mpi
def test_left_is_left_and_the_opposite_vertex_is_opposite() -> None:
    """Of a flat sheet with normals upwards, z · (t × (c - a)) is positive for the third vertex c on
    the left."""
    table = sheet(WORLD, 4, 3).edges
    x = vertex_points(table.domain)
    start, end = x[table.vertices].transpose(1, 0, 2)
    for column, sign in ((0, 1.0), (1, -1.0)):
        there = table.cells[:, column] >= 0
        third = x[table.opposite[there, column]]
        side = np.cross(end[there] - start[there], third - start[there])[:, 2]
        assert (sign * side > 1e-6).all()
        assert (table.sides[there, column] >= 0).all() and (
            table.opposite[~there, column] == -1
        ).all()


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
def test_nodes_go_from_end_to_end(order: int) -> None:
    mesh = airbag(WORLD, 1.0, 6)
    table = mesh.edges
    space = fem.functionspace(mesh.domain, ("Lagrange", order, (3,)))
    edges = np.flatnonzero((table.cells >= 0).any(axis=1)).astype(np.int32)
    nodes = space.tabulate_dof_coordinates()[table.nodes(space, edges)]
    ends = vertex_points(mesh.domain)[table.vertices[edges]]
    expected = (
        [ends[:, 0], ends[:, 1]] if order == 1 else [ends[:, 0], ends.mean(axis=1), ends[:, 1]]
    )
    assert nodes.transpose(1, 0, 2) == pytest.approx(np.array(expected), abs=1e-14)


@pytest.mark.mpi
def test_groups_of_edges() -> None:
    """The seam of an airbag is inside its closed surface, and the boundary of each of its
    sheets."""
    mesh = airbag(WORLD, 1.0, 6)
    table = mesh.edges
    seam = mesh.curve("seam", "test")
    assert owned(table, np.isin(np.arange(len(table.count)), seam)) == 24
    assert table.is_inside.all()
    count, directions = table.tally(mesh.group("top")[1])
    border = np.flatnonzero(count == 1)
    assert set(border) == set(seam[seam < table.owned]) and (abs(directions[border]) == 1).all()
    with pytest.raises(gx.InputError, match="Crease: the group 'top' has dimension 2; name curves"):
        mesh.curve("top", "Crease")


@pytest.mark.mpi
def test_three_sheets_at_one_edge_and_normals_that_differ() -> None:
    domain = three_sheets().domain
    table = edges_of(domain)
    assert sorted(table.count) == [1] * 6 + [3]
    assert not table.is_known[table.count == 3] and table.is_known[table.count == 1].all()
    assert (
        table.cells[table.count == 3] >= 0
    ).all()  # the first two of the three, though both pass it alike
    count, directions = table.tally(np.arange(3, dtype=np.int32))
    assert abs(directions[count == 3]) == 3
