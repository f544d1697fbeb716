"""Kernels are compiled once, and their cache survives runs that were interrupted while they
compiled."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.forms import compilation as forms
from gossamer_fx.core.forms.backend import evaluate
from gossamer_fx.meshes.sheet import sheet


@pytest.fixture
def cache(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of kernels."""
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
