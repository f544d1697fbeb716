"""Errors and orders of a quantity on several meshes."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.analysis import convergence
from gossamer_fx.meshes.sheet import sheet


@pytest.mark.parametrize("p", [1.0, 2.0, 3.5])
@pytest.mark.parametrize(
    "cells",
    [(4, 8, 16), (3, 5, 12, 20)],
    ids=str,
)
def test_the_limit_of_a_power_law_is_found(p, cells):
    found = convergence(lambda n: 3.0 - 0.7 * n**-p, meshes=cells)
    assert found.is_extrapolated == {"value": True}
    assert found.exact["value"] == pytest.approx(3.0, rel=1e-9)
    assert found.orders["value"][1:] == pytest.approx(p, rel=1e-4)


def test_an_exact_value_and_several_quantities():
    found = convergence(
        lambda n: {"a": 1 + 1 / n, "b": 1 / n**2}, meshes=[8, 2, 4], exact={"a": 1.0, "b": 0.0}
    )
    assert found.sizes.tolist() == [0.5, 0.25, 0.125]
    assert found.errors["a"].tolist() == [0.5, 0.25, 0.125]
    # The exact value is zero: errors are absolute.
    assert found.errors["b"].tolist() == [0.25, 0.0625, 0.015625]
    lines = found.table().splitlines()
    assert lines[0] == "| h | a | error | order | b | error | order | CPU time [s] |"
    assert lines[-1].startswith("| 0.125 | 1.125 | 1.2e-01 | 1.0 | 0.015625 | 1.6e-02 | 2.0 |")


def test_values_without_a_limit_have_no_errors():
    found = convergence(lambda n: (-1) ** round(math.log2(n)), meshes=[2, 4, 8])
    assert found.exact == {}
    assert np.isnan(found.errors["value"]).all()
    assert "has no errors" in found.table()


@pytest.mark.mpi
def test_sizes_of_meshes(comm, folder):
    """h of squares of two triangles is their side; the area has no error but round-off."""
    meshes = [
        sheet(
            comm,
            n,
            n,
        )
        for n in (2, 4)
    ]

    def area(mesh):
        film = gx.Membrane(
            mesh,
            gx.Linear(
                1e9,
                0.3,
                density=1.0,
                thickness=1.0,
            ),
        )
        return gx.Scene(film).compile().M.getDiagonal().sum() / 3

    found = convergence(
        area,
        meshes=meshes,
        exact=1.0,
    )
    assert found.sizes == pytest.approx([0.5, 0.25])
    assert found.cells.tolist() == [8, 32]
    assert (found.seconds >= 0).all()
    if comm.rank == 0:
        found.plot(
            folder / "area.png",
            others={"again": found},
            name="once",
        )
        assert (folder / "area.png").stat().st_size > 1000


def test_what_is_refused():
    with pytest.raises(gx.InputError, match="there are 1 meshes"):
        convergence(float, meshes=[2])
    with pytest.raises(gx.InputError, match="the quantity 'value' is nan"):
        convergence(lambda n: math.nan, meshes=[2, 4])
    with pytest.raises(gx.InputError, match="the size of 'coarse' is not known"):
        convergence(lambda n: 1.0, meshes=["coarse", "fine"])
    with pytest.raises(gx.InputError, match="give a positive number for each of the 2 meshes"):
        convergence(
            lambda n: 1.0,
            meshes=["coarse", "fine"],
            sizes=[1.0],
        )


def test_values_without_a_limit_are_drawn_as_they_are(folder):
    oscillating = convergence(lambda n: {"a": (-1) ** round(math.log2(n))}, meshes=[2, 4, 8])
    quadratic = convergence(lambda n: {"b": 1.0 + n**-2}, meshes=[2, 4, 8])
    # The picture is of values if no curve has errors, else of the curves that have them.
    assert [
        c[0]
        for c in oscillating._curves(
            "",
            {},
            of_errors=True,
        )
    ] == []
    assert [
        c[0]
        for c in oscillating._curves(
            "",
            {},
            of_errors=False,
        )
    ] == ["a"]
    curves = list(
        oscillating._curves(
            "",
            {"fine": quadratic},
            of_errors=True,
        )
    )
    assert [c[0] for c in curves] == ["fine"]
    oscillating.plot(folder / "values.png")
    assert (folder / "values.png").stat().st_size > 1000
