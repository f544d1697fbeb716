"""Kernels are compiled once, and their cache survives runs that were interrupted while they
compiled."""

from __future__ import annotations

import gc
import itertools
import weakref
from pathlib import Path

import dolfinx.jit
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.forms import compilation as forms
from gossamer_fx.core.forms.backend import evaluate, geometry_nodes
from gossamer_fx.meshes.sheet import sheet


@pytest.fixture
def cache(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of kernels, on disk and in the process."""
    monkeypatch.setattr(forms, "_kernels", {})
    options = forms.kernel_options() | {"cache_dir": str(folder)}
    monkeypatch.setattr(forms, "kernel_options", lambda: options)
    return folder


@pytest.mark.mpi
def test_kernels_that_were_never_finished_are_made_anew(comm, cache):
    domain = mesh.create_unit_square(comm, 3, 3)
    area = forms.constant(domain, 1.0) * ufl.dx(domain)
    x = ufl.SpatialCoordinate(domain)
    point = np.array([[0.25, 0.25]])

    def values():
        form = forms.compile_form(area)
        expression = forms.compile_expression(x[0] + x[1], point)
        return comm.allreduce(fem.assemble_scalar(form)), float(
            evaluate(expression, domain, np.zeros(1, dtype=np.int32))[0, 0]
        )

    first = values()
    assert first[0] == pytest.approx(1.0)
    comm.barrier()
    if (
        comm.rank == 0
    ):  # as if the compiler had been killed: the sources are there, the kernels are not
        sources = sorted(cache.glob("libffcx_*.c"))
        assert len(sources) == 2
        for source in sources:
            source.with_suffix(".c.cached").unlink()
    forms._kernels.clear()
    comm.barrier()
    assert values() == first
    comm.barrier()
    assert len(list(cache.glob("libffcx_*.c.cached"))) == 2


@pytest.mark.mpi
def test_an_error_of_the_compiler_is_shown(comm, cache):
    def task():
        raise RuntimeError("no space left on device")

    with pytest.raises(RuntimeError, match="no space"):
        forms._with_cache(comm, task)


def test_kernels_do_not_depend_on_what_was_made_before(cache, monkeypatch):
    """Behind any number of others: UFL signs with the numbers of labels, and sorts constants by
    theirs as words."""

    def kernels(others: int) -> set[str]:
        monkeypatch.setattr(ufl.Constant, "_counter", itertools.count(others))
        forms._kernels.clear()
        law = gx.Miyazaki(1e9, 0.3, density=1e3, thickness=1e-4, residual_stiffness=1e-6)
        film = gx.Membrane(sheet(MPI.COMM_SELF, 1, 1), law)
        gx.Scene(
            film,
            gx.Gravity(film),
            gx.Pressure(film, 5.0),
            gx.Damping(film, mass_factor=1.0, stiffness_factor=1e-3),
        ).compile()
        return {path.name for path in cache.glob("libffcx_*.c")}

    first = kernels(0)
    assert first
    for others in (2, 5, 8, 11, 95, 999):
        assert kernels(others) == first


# ---- kernels that a process has loaded -----------------------------------------------------------

MIDDLE = np.array([[1 / 3, 1 / 3]])


def numbered(domain: mesh.Mesh, values: tuple[float, ...], degree: int = 0) -> list[fem.Function]:
    """Functions with these values everywhere, created in this order."""
    space = fem.functionspace(domain, ("Discontinuous Lagrange", degree))
    functions = [fem.Function(space) for _ in values]
    for function, value in zip(functions, values, strict=True):
        function.x.array[:] = value
    return functions


def value_of(expression: object, domain: mesh.Mesh, points: np.ndarray = MIDDLE) -> float:
    """An expression in the first cell of a mesh, at the first of some points."""
    compiled = forms.compile_expression(expression, points)
    return float(evaluate(compiled, domain, np.zeros(1, dtype=np.int32))[0, 0])


def test_a_process_looks_for_a_kernel_once(cache, monkeypatch):
    """Further scenes of a kind have other meshes and functions, and ask FFCx for nothing."""
    searches = []
    search = dolfinx.jit.ffcx_jit

    def counted(*args, **options):
        searches.append(None)
        return search(*args, **options)

    monkeypatch.setattr(dolfinx.jit, "ffcx_jit", counted)

    def compile_scene(thickness: float) -> None:
        film = gx.Membrane(
            sheet(MPI.COMM_SELF, 1, 1), gx.Miyazaki(1e9, 0.3, density=1e3, thickness=thickness)
        )
        gx.Scene(film, gx.Gravity(film)).compile()

    counts = [0]
    for thickness in (1e-4, 2e-4, 3e-4):
        compile_scene(thickness)
        counts.append(len(searches))
    new = np.diff(counts)
    assert new[0] > 10
    # UFL sorts constants by their numbers as text: a scene whose numbers pass a power of ten has
    # other kernels.  Two in succession cannot.
    assert new[1:].min() == 0


def test_expressions_that_differ_in_one_detail_have_their_own_kernels():
    """Each is evaluated after all others: the kernel of another one would give its value."""
    domain = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    f, g = numbered(domain, (3.0, 5.0))
    later_g, later_f = numbered(domain, (5.0, 3.0))
    linear, _ = numbered(domain, (3.0, 5.0), degree=1)
    c = forms.constant(domain, 7.0)
    d = forms.constant(domain, 11.0)
    vector = ufl.as_vector([f, g])
    x = ufl.variable(f)
    X = ufl.SpatialCoordinate(domain)
    expected = [
        (f - 2 * g, -7.0),
        (g - 2 * f, -1.0),
        # as the first one, from functions that were made in the other order
        (later_f - 2 * later_g, -7.0),
        (f - 3 * g, -12.0),
        (linear - 2 * g, -7.0),
        (f - 2 * f, -3.0),
        (c - 2 * d, -15.0),
        (d - 2 * c, -3.0),
        (c - 2 * g, -3.0),
        (f / g, 0.6),
        (later_f / later_g, 0.6),
        (c / d, 7 / 11),
        (d / c, 11 / 7),
        (f * g, 15.0),
        (vector[0], 3.0),
        (vector[1], 5.0),
        (ufl.max_value(f, g), 5.0),
        (ufl.min_value(f, g), 3.0),
        (ufl.diff(x**2, x), 6.0),
        (ufl.diff(x**3, x), 27.0),
        (ufl.dot(vector, vector), 34.0),
        (ufl.conditional(ufl.lt(f, g), 1.0, 2.0), 1.0),
        (ufl.conditional(ufl.gt(f, g), 1.0, 2.0), 2.0),
    ]
    for _ in range(2):
        for expression, value in expected:
            assert value_of(expression, domain) == pytest.approx(value, rel=1e-14), str(expression)
        # The points are part of a kernel, too, and the cell and the order of its geometry.
        for points in (MIDDLE, np.array([[0.0, 0.0]]), np.array([[0.0, 1.0], [0.5, 0.5]])):
            corners = domain.geometry.x[geometry_nodes(domain)[0]]
            ξ, η = points[0]
            at = (1 - ξ - η) * corners[0] + ξ * corners[1] + η * corners[2]
            value = value_of(X[0] + 2 * X[1], domain, points)
            assert value == pytest.approx(at[0] + 2 * at[1], abs=1e-14)
    segment = mesh.create_unit_interval(MPI.COMM_SELF, 1)
    along = ufl.SpatialCoordinate(segment)[0]
    assert value_of(along, segment, np.array([[0.25]])) == pytest.approx(0.25)


def test_forms_that_differ_in_one_detail_have_their_own_kernels():
    domain = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    f, g = numbered(domain, (3.0, 5.0))
    x = ufl.SpatialCoordinate(domain)[0]
    facets = mesh.locate_entities_boundary(domain, 1, lambda X: np.isclose(X[0], 1.0))
    tags = mesh.meshtags(domain, 1, facets, np.full(len(facets), 4, dtype=np.int32))
    side = ufl.Measure("ds", domain, subdomain_data=tags)
    # A midpoint rule on two triangles gives 1/2 (1/9 + 4/9) for the square of x.
    coarse = ufl.Measure("dx", domain, metadata={"quadrature_degree": 1})
    exact = ufl.Measure("dx", domain, metadata={"quadrature_degree": 2})
    expected = [
        (x**2 * coarse, 5 / 18),
        (x**2 * exact, 1 / 3),
        (f * exact, 3.0),
        (f * g * exact, 15.0),
        (f * exact + g * coarse, 8.0),
        (f * ufl.ds(domain), 12.0),
        (f * ufl.ds(domain, metadata={"quadrature_degree": 2}), 12.0),
        (f * side(4), 3.0),
        (f * side(5), 0.0),
        (ufl.avg(f) * ufl.dS(domain), 3 * 2**0.5),
        (ufl.jump(f) * ufl.dS(domain), 0.0),
    ]
    for _ in range(2):
        for form, value in expected:
            found = fem.assemble_scalar(forms.compile_form(form))
            assert found == pytest.approx(value, rel=1e-14, abs=1e-14), str(form)


@pytest.mark.parametrize("options", [{"cffi_extra_compile_args": ["-O1"]}, {}])
def test_options_of_the_compiler_belong_to_a_kernel(cache, monkeypatch, options):
    domain = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    (f,) = numbered(domain, (3.0,))
    assert value_of(2 * f, domain) == 6.0
    changed = forms.kernel_options() | options
    monkeypatch.setattr(forms, "kernel_options", lambda: changed)
    assert value_of(2 * f, domain) == 6.0
    assert len(list(cache.glob("libffcx_*.c"))) == (2 if options else 1)


def test_the_compiler_does_not_search_its_graph_for_each_subexpression(cache, monkeypatch):
    from ffcx.ir.analysis.valuenumbering import ValueNumberer

    def search(*arguments):
        raise AssertionError("a search in proportion to the square of the expression")

    monkeypatch.setattr(ValueNumberer, "get_node_symbols", search)
    domain = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    (f,) = numbered(domain, (3.0,))
    # An indexed vector, whose symbols are those of its entries.
    v = ufl.as_vector([2 * f, f])
    assert value_of(v[0] + ufl.dot(v, v), domain) == pytest.approx(6.0 + 45.0)
    assert ValueNumberer.get_node_symbols is search


def test_kernels_keep_no_function_and_no_mesh(cache):
    def compiled() -> list[weakref.ref]:
        domain = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
        (f,) = numbered(domain, (3.0,))
        made = forms.compile_form(f * ufl.dx), forms.compile_expression(2 * f, MIDDLE)
        assert fem.assemble_scalar(made[0]) == pytest.approx(3.0)
        return [weakref.ref(one) for one in (domain, f, *made)]

    for _ in range(2):
        references = compiled()
        gc.collect()
        assert [reference() for reference in references] == [None] * 4
    assert len(forms._kernels) == 2


@pytest.mark.mpi
def test_a_kernel_that_one_rank_has_is_compiled_by_all(comm, cache):
    def integral(on: MPI.Intracomm) -> float:
        domain = mesh.create_unit_square(on, 3, 3)
        (f,) = numbered(domain, (3.0,))
        return float(on.allreduce(fem.assemble_scalar(forms.compile_form(f * ufl.dx))))

    if comm.rank == 0:
        assert integral(MPI.COMM_SELF) == pytest.approx(3.0)
    assert integral(comm) == pytest.approx(3.0)
    assert len(forms._kernels) == 1
