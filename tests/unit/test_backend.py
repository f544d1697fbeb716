"""The interface to dolfinx: one file contains all that depends on its version; sheets meet where
dolfinx allows it."""

from __future__ import annotations

import ast
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.forms import backend
from gossamer_fx.core.forms.compilation import compile_expression, constant
from gossamer_fx.meshes.sheet import sheet

PACKAGE = Path(gx.__file__).parent
SEAM = Path(backend.__file__)
# called with other arguments, or of another kind or place, in another version
NAMES = {
    "create_mesh",
    "create_cell_partitioner",
    "cmap",
    "cmaps",
    "dofmaps",
    "interpolation_points",
    "cell_perm_array",
    "pack_constants",
    "pack_coefficients",
}
MODULES = {"dolfinx.cpp", "dolfinx.io.gmshio", "dolfinx.io.gmsh"}
FOLDERS = (PACKAGE, *(PACKAGE.parent / name for name in ("demos", "meshes", "tests")))
FILES = sorted(path for folder in FOLDERS for path in folder.rglob("*.py"))


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE.parent)))
def test_only_the_seam_knows_the_version(path: Path) -> None:
    if path in {SEAM, Path(__file__)}:
        return
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Attribute):
            assert node.attr not in NAMES, (
                f"line {node.lineno}: take {node.attr} from forms/backend.py"
            )
            assert not (node.attr == "dofmap" and _is_of_geometry(node)), (
                f"line {node.lineno}: use backend.geometry_nodes"
            )
            assert not (node.attr == "eval" and _is_method(node)), (
                f"line {node.lineno}: use backend.evaluate"
            )
        elif isinstance(node, ast.ImportFrom):
            words = {f"{node.module}.{alias.name}" for alias in node.names} | {node.module}
            ours = (node.module or "").startswith("gossamer_fx")
            assert not words & MODULES, (
                f"line {node.lineno}: {node.module} belongs into forms/backend.py"
            )
            assert ours or not NAMES & {alias.name for alias in node.names}, f"line {node.lineno}"
        elif isinstance(node, ast.Import):
            assert not {alias.name for alias in node.names} & MODULES, f"line {node.lineno}"


def _is_method(node: ast.Attribute) -> bool:
    """Not the `eval` of a module."""
    return not (isinstance(node.value, ast.Name) and node.value.id in {"builtins", "ast"})


def _is_of_geometry(node: ast.Attribute) -> bool:
    """Not the `dofmap` of a space."""
    return ast.unparse(node.value).endswith("geometry")


def test_another_version_is_refused_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dolfinx.__version__", "0.12.0")
    with pytest.raises(ImportError, match=r"0\.9, 0\.10 and 0\.11, and this is 0\.12\.0"):
        runpy.run_path(str(SEAM))


@pytest.mark.mpi
def test_an_expression_is_evaluated_to_rows(comm: MPI.Comm) -> None:
    domain = sheet(comm, 2, 2).domain
    cells = np.arange(domain.topology.index_map(2).size_local, dtype=np.int32)
    X = ufl.SpatialCoordinate(domain)
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    corners = domain.geometry.x[backend.geometry_nodes(domain)[cells]]
    vector = compile_expression(constant(domain, 2.0) * X, points)
    assert np.allclose(backend.evaluate(vector, domain, cells), 2 * corners.reshape(len(cells), 9))
    scalar = compile_expression(constant(domain, 2.0) * X[0], points)
    assert np.allclose(backend.evaluate(scalar, domain, cells), 2 * corners[:, :, 0])
    assert backend.evaluate(scalar, domain, cells[:0]).shape == (0, 3)


@pytest.mark.parametrize("order, expected", [(1, 3), (2, 6)])
def test_interpolation_points_are_nodes(comm: MPI.Comm, order: int, expected: int) -> None:
    space = fem.functionspace(sheet(comm, 1, 1).domain, ("Lagrange", order))
    points = backend.interpolation_points(space)
    assert points.shape == (expected, 2) and {(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)} <= set(
        map(tuple, points)
    )


@pytest.mark.mpi
@pytest.mark.parametrize("dim, cells, nodes", [(1, 12, 13), (2, 24, 21)])
def test_sheets_or_lines_meet_three_at_a_place(
    comm: MPI.Comm, dim: int, cells: int, nodes: int
) -> None:
    """Three sheets on one edge, three lines from one point: known to dolfinx since 0.10 on several
    ranks."""

    def build(model: Any) -> None:
        geo = model.geo
        turns = 2 * np.pi / 3 * np.arange(3)
        axis = [geo.addPoint(x, 0, 0) for x in (0, 1)]
        rims = [[geo.addPoint(x, np.cos(t), np.sin(t)) for x in (0, 1)] for t in turns]
        if dim == 1:
            lines = [geo.addLine(axis[0], rim[0]) for rim in rims]
        else:
            base = geo.addLine(*axis)
            lines = [base]
            for rim in rims:
                sides = [
                    geo.addLine(axis[1], rim[1]),
                    geo.addLine(rim[1], rim[0]),
                    geo.addLine(rim[0], axis[0]),
                ]
                lines += sides
                geo.mesh.setTransfiniteSurface(
                    geo.addPlaneSurface([geo.addCurveLoop([base, *sides])])
                )
        for line in lines:
            geo.mesh.setTransfiniteCurve(line, 5 if dim == 1 else 3)
        geo.synchronize()
        model.mesh.generate(dim)

    if comm.size > 1 and not backend.SHEETS_MAY_MEET:
        with pytest.raises(gx.InputError, match="3 cells of the mesh meet"):
            gx.gmsh_mesh(build, comm)
        return
    mesh = gx.gmsh_mesh(build, comm)
    sizes = [mesh.domain.topology.index_map(d).size_global for d in (dim, 0)]
    assert sizes == [cells, nodes]
    if dim == 2:
        assert comm.allreduce(mesh.edges.count.max(), op=MPI.MAX) == 3
