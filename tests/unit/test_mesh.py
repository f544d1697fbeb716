"""Meshes from gmsh: cells, shapes and named groups, the same on any number of ranks."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx import InputError, Membrane, Mesh, Miyazaki, gmsh_mesh, read_mesh
from gossamer_fx.meshes import antenna, disc, plates, revolved, sails, tube_section
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.arrays import mesh_of_arrays
from gossamer_fx.meshes.creased import creased_film, creased_tube
from gossamer_fx.meshes.creased_strip import creased_strip
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import CORNERS, EDGES, crossed_sheet, sheet
from gossamer_fx.meshes.sphere import sphere
from gossamer_fx.meshes.tube import flat_tube
from tests.hanging import HANG_TIMEOUT

LAW = Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)
AIR = {"gas": gx.presets.gases.AIR, "pressure": 1e5, "temperature": 300.0}


def count(mesh: Mesh, name: str) -> int:
    """Entities of a group, each counted on the rank that owns it."""
    dim, entities = mesh.group(name)
    owned = mesh.domain.topology.index_map(dim).size_local
    return mesh.comm.allreduce(int((entities < owned).sum()))


def area(mesh: Mesh) -> float:
    film = Membrane(mesh, LAW, order=2)
    return mesh.comm.allreduce(
        fem.assemble_scalar(fem.form(fem.Constant(mesh.domain, 1.0) * film.dx))
    )


@pytest.mark.mpi
def test_sheet_has_its_cells_edges_and_corners(comm):
    mesh = sheet(comm, 6, 4, 3.0, 2.0)
    assert mesh.domain.topology.index_map(2).size_global == 48 == count(mesh, "film")
    assert mesh.domain.topology.index_map(0).size_global == 35
    assert [count(mesh, edge) for edge in EDGES] == [6, 4, 6, 4]
    assert [count(mesh, corner) for corner in CORNERS] == [1, 1, 1, 1]
    assert area(mesh) == pytest.approx(6.0, rel=1e-13)


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
def test_nodes_of_a_group_are_where_the_group_is(comm, order):
    film = Membrane(sheet(comm, 6, 4, 3.0, 2.0), LAW, order=order)
    X = film.space.tabulate_dof_coordinates()
    assert abs(X[film.nodes("right"), 0] - 3.0).max(initial=0) <= 1e-12
    assert abs(X[film.nodes("top"), 1] - 2.0).max(initial=0) <= 1e-12
    owned = film.nodes("right") < film.block.index_map.size_local
    assert comm.allreduce(int(owned.sum())) == 4 * order + 1
    node = film.port("top right").nodes[0]
    first, last = film.block.index_map.local_range
    if first <= node < last:
        assert X[node - first] == pytest.approx([3.0, 2.0, 0.0])


@pytest.mark.mpi(2)
@pytest.mark.parametrize("order, nodes", [(1, 35), (2, 117)])
def test_film_of_either_order_has_its_nodes(comm, order, nodes):
    assert Membrane(sheet(comm, 6, 4), LAW, order=order).block.index_map.size_global == nodes


@pytest.mark.mpi
def test_sheets_of_an_airbag_meet_on_the_seam_only(comm):
    mesh = airbag(comm, 1.0, 6)
    assert count(mesh, "top") == count(mesh, "bottom") == 72 and count(mesh, "seam") == 24
    assert mesh.domain.topology.index_map(0).size_global == 2 * 49 - 24
    assert (
        mesh.domain.topology.index_map(1).size_global == (3 * 144) // 2
    )  # closed: every edge has two triangles
    assert area(mesh) == pytest.approx(2.0, rel=1e-13)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order, rate", [(1, 2), (2, 4)])
def test_curved_triangles_have_the_area_of_the_sphere(comm, order, rate):
    cells = (12, 24, 48)
    errors = [abs(area(sphere(comm, 2.0, n, order)) / (16 * math.pi) - 1) for n in cells]
    assert -np.polyfit(np.log(cells), np.log(errors), 1)[0] == pytest.approx(rate, abs=0.35)


@pytest.mark.mpi
def test_file_keeps_the_names_of_its_groups(comm, folder):
    path = folder / "strip.msh"

    def write(model):
        import gmsh

        points = [model.geo.addPoint(x, y, 0) for x, y in ((0, 0), (2, 0), (2, 1), (0, 1))]
        lines = [model.geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
        surface = model.geo.addPlaneSurface([model.geo.addCurveLoop(lines)])
        for side in lines:
            model.geo.mesh.setTransfiniteCurve(side, 5)
        model.geo.mesh.setTransfiniteSurface(surface)
        model.geo.synchronize()
        model.addPhysicalGroup(2, [surface], name="strip")
        model.addPhysicalGroup(1, [lines[3]], name="clamp")
        model.addPhysicalGroup(0, [points[2]], 7)
        model.mesh.generate(2)
        gmsh.write(str(path))

    built = gmsh_mesh(write, comm)
    comm.barrier()
    mesh = read_mesh(path, comm)
    for m in (built, mesh):
        assert {name: dim for name, (dim, _) in m.groups.items()} == {
            "strip": 2,
            "clamp": 1,
            "7": 0,
        }
        assert (count(m, "strip"), count(m, "clamp"), count(m, "7")) == (32, 4, 1)
    assert area(mesh) == pytest.approx(2.0, rel=1e-13)


@pytest.mark.mpi
def test_cells_outside_any_group_are_left_out(comm):
    """As gmsh itself does when it saves: with physical surfaces, these alone are the mesh."""

    def two_squares(model):
        first = model.occ.addRectangle(0, 0, 0, 1, 1)
        model.occ.addRectangle(2, 0, 0, 1, 1)
        model.occ.synchronize()
        model.addPhysicalGroup(2, [first], name="wanted")
        model.mesh.generate(2)

    assert area(gmsh_mesh(two_squares, comm)) == pytest.approx(1.0, rel=1e-13)


@pytest.mark.mpi
def test_orientation_of_the_cells_survives(comm):
    """Normals of a closed surface keep pointing outwards, also where dolfinx reorders the vertices
    of cells."""
    import ufl

    for order in (1, 2):
        mesh = sphere(comm, 1.0, 12, order)
        X = ufl.SpatialCoordinate(mesh.domain)
        n = ufl.CellNormal(mesh.domain)
        outward = fem.form(
            ufl.conditional(ufl.gt(ufl.dot(X, n), 0), 1.0, 0.0) * ufl.dx(mesh.domain)
        )
        assert comm.allreduce(fem.assemble_scalar(outward)) == pytest.approx(area(mesh), rel=1e-3)


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    "cells, culprit", [([[0, 1, 1]], "has the node 2 twice"), ([[0, 1, 2]] * 2, "same nodes")]
)
def test_cells_that_cannot_be_are_told(comm, cells, culprit):
    points = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0)])
    with pytest.raises(InputError, match=culprit):
        mesh_of_arrays(comm, lambda: (points, np.array(cells), {}))


def test_surfaces_of_arrays_overlap_and_need_not_cover_the_mesh(comm):
    points = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0)])
    cells = np.array([(0, 1, 2), (0, 2, 3), (1, 4, 2)])
    groups = {"left": cells[:2], "lower": cells[[0, 2]]}
    mesh = mesh_of_arrays(comm, lambda: (points, cells, groups))
    areas = {name: comm.allreduce(len(entities)) / 2 for name, (_, entities) in mesh.groups.items()}
    assert areas == {"film": 1.5, "left": 1.0, "lower": 1.0}
    with pytest.raises(InputError, match="'lower' has a triangle that is none of the triangles"):
        mesh_of_arrays(comm, lambda: (points, cells[:2], groups))


@pytest.mark.mpi
def test_unknown_group_is_told_with_the_known_ones(comm):
    with pytest.raises(InputError, match=r"no group 'lid'.*bottom.*film"):
        sheet(comm, 2, 2).group("lid")


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    "use",
    [
        lambda film: film.ports("lid"),
        lambda film: gx.Fixed(film, "lid"),
        lambda film: gx.Tie(film, gx.Membrane(film.mesh, LAW), group_a="lid", group_b="left"),
        lambda film: gx.Tie(gx.Membrane(film.mesh, LAW), film, group_a="left", group_b="lid"),
        lambda film: gx.loads.EdgeLoad(film, "lid", normal_force=1.0),
        lambda film: gx.connectors.Crease(film, "lid", stiffness=1.0),
        lambda film: gx.Scene(gx.Chamber(film, surface=("lid",), **AIR)).compile(),
        lambda film: gx.Membrane(film.mesh, LAW, properties={"E": {"lid": 1.0}}, name="sail"),
    ],
)
def test_a_body_without_a_group_is_named(comm, use):
    film = gx.Membrane(sheet(comm, 2, 2), LAW, name="sail")
    with pytest.raises(InputError, match=r"'sail'.*: the mesh has no group 'lid'; .*bottom.*film"):
        use(film)


@pytest.mark.mpi
def test_ranks_share_the_mesh_that_one_has_alone(comm):
    """Counts on this communicator are those of one rank alone."""
    alone = sheet(MPI.COMM_SELF, 5, 3)
    shared = sheet(comm, 5, 3)
    for dim in range(3):
        for mesh in (alone, shared):
            mesh.domain.topology.create_entities(dim)
        sizes = [mesh.domain.topology.index_map(dim).size_global for mesh in (alone, shared)]
        assert sizes[0] == sizes[1]
    assert {name: count(alone, name) for name in alone.groups} == {
        name: count(shared, name) for name in shared.groups
    }


SCRIPT = 'SystemCall "touch {}";\nPoint(1) = {{0, 0, 0, 1}};\n'
NO_MESHES = {
    "pillow.msh": SCRIPT,
    "pillow.geo": SCRIPT,
    "pillow.pos": 'View "v" {{ SP(0,0,0){{1}}; }};\nSystemCall "touch {}";\n',
    "behind blanks.msh": "\n  " + SCRIPT,
    "behind a comment.msh": "// $MeshFormat\n" + SCRIPT,
    "version 1.msh": "$NOD\n1\n1 0 0 0\n$ENDNOD\n" + SCRIPT,
    "version 3.msh": "$MeshFormat\n3 0 8\n$EndMeshFormat\n" + SCRIPT,
    "torn.msh": "$MeshFormat\n" + SCRIPT,
    "comments.msh": "$Comments\n$EndComments\n" + SCRIPT,
    "empty.msh": "",
    "model.step": "ISO-10303-21;\n",
}


@pytest.mark.mpi(1)
@pytest.mark.parametrize("name", NO_MESHES)
def test_a_script_is_not_executed(folder: Path, comm: MPI.Comm, name: str) -> None:
    """gmsh runs what it does not take for a mesh, shell commands included."""
    path = folder / name
    mark = folder / "executed"
    if comm.rank == 0:
        path.write_text(NO_MESHES[name].format(mark))
    comm.barrier()
    with pytest.raises(InputError, match=r"is not in MSH format 2\.2 or 4\.x; .*\.$"):
        read_mesh(path, comm)
    assert not mark.exists()


def test_what_stands_beside_or_behind_a_mesh_is_not_executed(tmp_path: Path) -> None:
    """gmsh merges `NAME.opt`, and goes by the end of a name before it looks into a file."""
    mark = tmp_path / "executed"
    square = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
    for name in ("a.msh", "a.geo", "a.pos", "a.py"):
        (tmp_path / name).write_text(square + SCRIPT.format(mark))
        (tmp_path / f"{name}.opt").write_text(SCRIPT.format(mark))
        with pytest.raises(InputError, match="no triangles"):
            read_mesh(tmp_path / name, MPI.COMM_SELF)
    assert not mark.exists()


LEFT_OUT = {
    # One triangle of three nodes and one of six, on the same surface.
    "orders": ("2 2 2 1 1 3 4", '2 2 "film"', "triangles of both orders"),
    "names": ("9 2 2 1 1 3 4 7 8 9", '1 1 "film"\n2 2 "film"', "two groups 'film'"),
}


@pytest.mark.parametrize("what", LEFT_OUT)
def test_what_would_be_left_out_of_a_file_is_refused(tmp_path: Path, what: str) -> None:
    """gmsh left out triangles of another order, and the second group of a name took the first."""
    element, names, words = LEFT_OUT[what]
    points = ["0 0", "1 0", "1 1", "0 1", ".5 0", "1 .5", ".5 .5", ".5 1", "0 .5"]
    nodes = "\n".join(f"{k} {xy} 0" for k, xy in enumerate(points, 1))
    parts = {
        "MeshFormat": "2.2 0 8",
        "PhysicalNames": f"{names.count('film')}\n{names}",
        "Nodes": f"9\n{nodes}",
        "Elements": f"3\n1 9 2 2 1 1 2 3 5 6 7\n2 {element}\n3 8 2 1 1 1 4 9",
    }
    path = tmp_path / "a.msh"
    path.write_text("".join(f"${name}\n{part}\n$End{name}\n" for name, part in parts.items()))
    with pytest.raises(InputError, match=words):
        read_mesh(path, MPI.COMM_SELF)


def bow_tie(model):
    """An outline that crosses itself, on which gmsh hangs."""
    points = [model.geo.addPoint(x, y, 0, 0.3) for x, y in ((0, 1), (1, 0), (1, 1), (0, 0))]
    lines = [model.geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
    model.geo.addPlaneSurface([model.geo.addCurveLoop(lines)])
    model.geo.synchronize()
    model.mesh.generate(2)


@pytest.mark.mpi
def test_a_time_limit_ends_gmsh(comm):
    with pytest.raises(InputError, match=r"function was not made within 2 s; .* larger time_limit"):
        gmsh_mesh(bow_tie, comm, time_limit=2.0)


INTERRUPTED = """
from mpi4py import MPI
from gossamer_fx import gmsh_mesh

def endless(model):
    print("gmsh works", flush=True)
    while True:
        pass

gmsh_mesh(endless, MPI.COMM_SELF)
"""


def test_ctrl_c_ends_gmsh():
    # A separate process: other tests leave this one with other actions of the signal.
    child = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "gmsh works\n"
    child.send_signal(signal.SIGINT)
    # Ends only when gmsh's process, which holds the pipes too, has ended.
    _, said = child.communicate(timeout=HANG_TIMEOUT)
    assert child.returncode == -signal.SIGINT
    assert said.rstrip().endswith("KeyboardInterrupt")


def test_what_a_function_raises_is_named_and_noted(tmp_path):
    def build(model):
        raise SystemExit("of the user")

    with pytest.raises(InputError, match=r"SystemExit \(of the user\); correct it") as caught:
        gmsh_mesh(build, MPI.COMM_SELF)
    assert "in build" in caught.value.__cause__.__notes__[0]


@pytest.mark.mpi
def test_a_mesh_says_how_large_it_is_and_which_groups_it_has(comm):
    words = repr(sheet(comm, 3, 2))
    assert words.startswith("<Mesh of 12 triangles, 12 points; groups: ")
    assert "film (surfaces)" in words and "left (curves)" in words


def test_a_file_without_groups_is_warned_of(tmp_path, caplog):
    def square(model):
        model.occ.addRectangle(0, 0, 0, 1, 1)
        model.occ.synchronize()
        model.mesh.setSize(model.getEntities(0), 0.5)
        model.mesh.generate(2)

    def named_square(model):
        model.occ.addRectangle(0, 0, 0, 1, 1)
        model.occ.synchronize()
        model.addPhysicalGroup(2, [1], name="film")
        model.mesh.generate(2)

    import gmsh

    for name, build in (("bare", square), ("named", named_square)):
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        build(gmsh.model)
        gmsh.write(str(tmp_path / f"{name}.msh"))
        gmsh.finalize()
    caplog.set_level("INFO", logger="gossamer_fx")
    read_mesh(tmp_path / "bare.msh", MPI.COMM_SELF)
    read_mesh(tmp_path / "named.msh", MPI.COMM_SELF)
    bare, named = caplog.records
    assert bare.levelname == "WARNING" and "groups: none" in bare.getMessage()
    assert named.levelname == "INFO" and "groups: film (surfaces)" in named.getMessage()


TRIANGLE = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))

# A call of each generator with arguments that are possible; numbers in it must be positive.
GENERATORS = [
    (sheet, {"nx": 2, "ny": 2, "width": 1.0, "height": 1.0}),
    (crossed_sheet, {"nx": 2, "ny": 2, "width": 1.0, "height": 1.0}),
    (airbag, {"edge": 1.0, "cells": 4}),
    (antenna.film, {"cells": 3, "side": 1.0}),
    (antenna.boom, {"elements": 3, "side": 1.0, "diagonal": (1.0, 1.0)}),
    (creased_film, {"corners": TRIANGLE, "lines": (), "size": (1.0, 1.0, 1.0)}),
    (
        creased_tube,
        {"corners": TRIANGLE, "lines": (), "size": 0.1, "rows": lambda X: X[:, 0], "walls": ()},
    ),
    (creased_strip, {"nx": 1, "ny": 1, "length": 1.0, "width": 1.0}),
    (disc.quarter_disc, {"cells": 2, "radius": 1.0}),
    (disc.ring, {"inner": 1.0, "outer": 2.0, "radial": 2, "around": 8}),
    (line, {"points": [(0, 0, 0), (1, 0, 0)], "elements": 2}),
    (plates.irregular_sheet, {"nx": 2, "ny": 2, "width": 1.0, "height": 1.0}),
    (plates.leaning_sheet, {"nx": 2, "ny": 2, "width": 1.0, "height": 0.1, "ramp": 0.1}),
    (plates.slit_ring, {"radial": 1, "around": 4, "inner": 1.0, "outer": 2.0}),
    (plates.free_slit_ring, {"size": 0.5, "inner": 1.0, "outer": 2.0}),
    (revolved.whole_disc, {"cells": 2, "radius": 1.0}),
    (revolved.torus, {"radius": 1.0, "tube_radius": 0.2, "around": 8, "around_tube": 4}),
    (revolved.hull, {"radius": 1.0, "length": 1.0, "cells": 2, "cap_height": 0.5}),
    (revolved.dish, {"radius": 1.0, "focal_length": 1.0, "cells": 2}),
    (revolved.balloon, {"radius": 1.0, "gores": 6, "cells": 1, "height": 1.0}),
    (sails.parallelograms, {"a": 1.0, "b": 1.0, "gamma": 1.0, "columns": 1, "rows": 1, "cells": 1}),
    (sails.trapezoids, {"n": 4, "inner": 1, "outer": 3, "pitch": 0.1}),
    (sails.pinwheel, {"n": 6, "side": 1.0, "columns": 1, "reach": 2}),
    (sphere, {"radius": 1.0, "cells": 6}),
    (flat_tube, {"length": 1.0, "diameter": 0.1, "cells": 2, "compartments": 1}),
    (tube_section.capped_cylinder, {"radius": 1.0, "length": 1.0, "around": 4, "along": 1}),
    (tube_section.cylinder, {"radius": 1.0, "length": 1.0, "around": 4, "along": 1}),
]
# What does not fit to the other arguments of the call.
WRONG_SIZES = [
    (sheet, {"height": math.nan}),
    (creased_film, {"size": (0, 1, 1)}),
    (disc.quarter_disc, {"order": 3}),
    (disc.ring, {"outer": 0.5}),
    (line, {"elements": [-1]}),
    (line, {"points": [(0, 0, 0)]}),
    (plates.slit_ring, {"outer": 1.0}),
    (sails.parallelograms, {"gamma": 2.0}),
    (sails.trapezoids, {"n": 2}),
    (sails.trapezoids, {"outer": 1}),
    (tube_section.cylinder, {"around": 2.0}),
    (sphere, {"cells": 3}),
]


@pytest.mark.parametrize("generator, given", GENERATORS)
def test_sizes_of_meshes_are_positive(generator, given):
    # Else the refusals could be those of another argument.
    assert generator(MPI.COMM_SELF, **given).domain.geometry.x.size > 0
    for name, value in given.items():
        if not isinstance(value, int | float):
            continue
        for bad in (type(value)(0), type(value)(-1)):
            with pytest.raises(InputError, match=rf"\b{name} (is|has) .*; give"):
                generator(MPI.COMM_SELF, **given | {name: bad})


def test_cells_count_as_they_are_made() -> None:
    """One cell around is made as four."""
    with pytest.raises(InputError, match=r"cylinder has about 2.4e\+07 cells"):
        tube_section.cylinder(MPI.COMM_SELF, 1.0, 1.0, around=1, along=3_000_000)


@pytest.mark.parametrize("generator, wrong", WRONG_SIZES)
def test_sizes_that_no_mesh_can_have_are_refused_by_name(generator, wrong):
    [name] = wrong
    given = dict(GENERATORS)[generator]
    with pytest.raises(InputError, match=rf"\b{name} (is|has) .*; give"):
        generator(MPI.COMM_SELF, **given | wrong)


@pytest.mark.parametrize("damaged", [0, 2])
def test_triangles_that_gmsh_leaves_out_are_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, damaged: int
) -> None:
    corners = [("0 0 0", "1 0 0", "0 1 0"), ("1 0 0", "1 1 0", "0 1 0")]
    corners += [("0 0 0", "1 0 0", "1 0 0"), ("1 1 0", "1 1 0", "0 1 0")][:damaged]
    facets = [
        "facet normal 0 0 1\nouter loop\n"
        + "".join(f"vertex {corner}\n" for corner in of_one)
        + "endloop\nendfacet\n"
        for of_one in corners
    ]
    (tmp_path / "a.stl").write_text(f"solid a\n{''.join(facets)}endsolid a\n")

    def build(model: Any) -> None:
        import gmsh

        gmsh.merge(str(tmp_path / "a.stl"))

    with caplog.at_level("WARNING", logger="gossamer_fx"):
        gx.gmsh_mesh(build, MPI.COMM_SELF)
    told = [record.getMessage() for record in caplog.records if "left out" in record.getMessage()]
    assert len(told) == (damaged > 0)
    assert not told or f"left out {damaged} triangles" in told[0]


def test_a_crash_of_gmsh_ends_its_process_alone() -> None:
    """PETSc's handler of crashes, which a fork inherits, would abort all ranks."""
    program = """
        import os
        import signal

        from petsc4py import PETSc

        from gossamer_fx.core.mesh.gmsh_reader import BadMesh, in_child

        PETSc.COMM_WORLD
        try:
            in_child(lambda: os.kill(os.getpid(), signal.SIGSEGV), "the mesh", 60.0)
        except BadMesh as error:
            print(error)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "the mesh" in done.stdout
    assert done.returncode == 0
    assert "MPI_ABORT" not in done.stderr and "PETSC ERROR" not in done.stderr


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
def test_a_mesh_that_is_moved_is_the_same_elsewhere(comm, order):
    """Areas and groups are those of the mesh, and the points are turned and shifted."""
    mesh = disc.ring(comm, 0.5, 1.0, 1, 8, order=order)
    moved = mesh.moved(to=(1.0, 2.0, 3.0), x=(0.0, 0.0, 5.0), y=(2.0, 0.0, 0.0))
    x, y, z = mesh.domain.geometry.x.T
    assert moved.domain.geometry.x == pytest.approx(np.array([1 + y, 2 + 0 * z, 3 + x]).T)
    assert moved.groups == mesh.groups
    area = fem.assemble_scalar(fem.form(1.0 * ufl.dx(mesh.domain)))
    assert fem.assemble_scalar(fem.form(1.0 * ufl.dx(moved.domain))) == pytest.approx(area)
    film = Membrane(moved, LAW, order=order)
    assert film.port_at((1.0, 2.0, 4.0), snap=True).initial() == pytest.approx([1, 2, 4])


def test_a_mesh_is_not_moved_to_axes_that_are_skew(comm):
    with pytest.raises(InputError, match="at a right angle, and are at 45°"):
        sheet(comm, 1, 1).moved(x=(1.0, 1.0, 0.0))
    with pytest.raises(InputError, match=r"y is \(0\.0, 0\.0, 0\.0\)"):
        sheet(comm, 1, 1).moved(y=(0.0, 0.0, 0.0))
