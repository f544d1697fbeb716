"""Errors and orders of a quantity on several meshes."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.analysis import convergence
from gossamer_fx.meshes.sheet import sheet


@pytest.mark.parametrize("p", [1.0, 2.0, 3.5])
@pytest.mark.parametrize("cells", [(4, 8, 16), (3, 5, 12, 20)], ids=str)
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


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ([1.0, -1.0, 1.0], "its values oscillate"),
        ([0.0, 0.0, 0.0], "all equal"),
        ([2.0, 2.0 + 1e-10, 2.0 - 1e-10], "all equal"),
        ([3.0, 2.0, 1.0], "order below 0.5"),
        ([1.0, 2.0, 4.0], "order below 0.5"),
        ([0.0, 1.0, 1.0 + 1e-4], "order above 10"),
        ([0.0, 1.0, 1.0], "two of its values are equal"),
        # A frequency: the three finest values alone fit the order 0.68 and the limit -0.17.
        ([0.9, 0.5, 0.25], "all its values have one sign"),
        # As measured for a sail whose coarsest mesh has a mode without stiffness.
        ([0.0, 0.21556, 0.21575, 0.21582], "leave out the coarsest"),
        ([1.4, 1.2, 1.1, 1.0875], "its order changes from 1.0 to 3.0"),
        ([1.0, 2.0], "two meshes show no limit"),
    ],
)
def test_values_outside_the_asymptotic_range_have_no_limit(values, reason, caplog):
    cells = [4 * 2**k for k in range(len(values))]
    found = convergence(lambda n: values[cells.index(n)], meshes=cells)
    assert found.exact == {}
    assert np.isnan(found.errors["value"]).all()
    assert reason in found.remarks["value"]
    assert f"value has no errors: {found.remarks['value']}." in found.table()
    change = abs(values[-1] - values[-2])
    assert ("change between the two finest meshes" in found.table()) == (change > 0)
    assert reason in caplog.text


def test_meshes_of_any_ratio_are_compared_by_their_order():
    """The last change is larger than the one before, as the last mesh is much finer."""
    found = convergence(lambda n: 1.0 + 1.0 / n, meshes=[8, 10, 20])
    assert found.exact["value"] == pytest.approx(1.0, rel=1e-9)
    assert found.remarks == {}


def test_a_small_limit_of_the_other_sign_is_the_estimate_of_a_zero():
    values = {4: 1e-3, 8: 2.4e-4, 16: 5.6e-5}
    found = convergence(values.__getitem__, meshes=[4, 8, 16])
    assert -1e-5 < found.exact["value"] < 0


@pytest.mark.mpi
def test_sizes_of_meshes(comm, folder):
    """h of squares of two triangles is their side; the area has no error but round-off."""
    meshes = [sheet(comm, n, n) for n in (2, 4)]

    def area(mesh):
        film = gx.Membrane(mesh, gx.Linear(1e9, 0.3, density=1.0, thickness=1.0))
        return gx.Scene(film).compile().unknowns.M.getDiagonal().sum() / 3

    found = convergence(area, meshes=meshes, exact=1.0)
    assert found.sizes == pytest.approx([0.5, 0.25])
    assert found.cells.tolist() == [8, 32]
    assert (found.seconds >= 0).all()
    if comm.rank == 0:
        found.plot(folder / "area.png", others={"again": found}, name="once")
        assert (folder / "area.png").stat().st_size > 1000


def test_a_mesh_without_a_number_is_named_and_the_others_are_kept(caplog, folder):
    def quantity(n):
        lost = math.nan if n == 8 else 1.0 + n**-2
        return {"kept [m]": 2.0 + n**-2, "lost [m]": lost}

    found = convergence(quantity, meshes=[2, 4, 8, 16, 32])
    assert "lost [m] is not finite on the mesh of h = 0.125" in caplog.text
    assert "kept" not in caplog.text
    assert found.exact == pytest.approx({"kept [m]": 2.0, "lost [m]": 1.0})
    assert found.orders["lost [m]"] == pytest.approx([math.nan, 2, math.nan, 2, 2], nan_ok=True)
    assert "lost [m] is not finite on the mesh of h = 0.125" in found.table()
    found.plot(folder / "errors.png")


def test_values_of_each_unit_have_axes_of_their_own(monkeypatch, folder):
    drawn = {}

    def draw(path, rows, **further):
        drawn.update(rows)

    monkeypatch.setattr("gossamer_fx.analysis.mesh_convergence.draw_error_curves", draw)
    names = ["height [m]", "width [m]", "stress [Pa]", "share"]
    found = convergence(lambda n: dict.fromkeys(names, 1.0), meshes=[2, 4])
    found.plot(folder / "values.png")
    assert {label: [curve.name for curve in curves] for label, curves in drawn.items()} == {
        "value [m]": ["height [m]", "width [m]"],
        "value [Pa]": ["stress [Pa]"],
        "value": ["share"],
    }


def test_what_is_refused():
    with pytest.raises(gx.InputError, match=r"meshes is \[2\], of length 1"):
        convergence(float, meshes=[2])
    with pytest.raises(gx.InputError, match="the quantity 'value' is nan"):
        convergence(lambda n: math.nan, meshes=[2, 4])
    with pytest.raises(gx.InputError, match="the size of 'coarse' is not known"):
        convergence(lambda n: 1.0, meshes=["coarse", "fine"])
    with pytest.raises(gx.InputError, match="meshes has 2 and sizes has 1 entries"):
        convergence(lambda n: 1.0, meshes=["coarse", "fine"], sizes=[1.0])


def test_values_without_a_limit_are_drawn_as_they_are(folder):
    oscillating = convergence(lambda n: {"a": (-1) ** round(math.log2(n))}, meshes=[2, 4, 8])
    quadratic = convergence(lambda n: {"b": 1.0 + n**-2}, meshes=[2, 4, 8])
    # The picture is of values if no curve has errors, else of the curves that have them.
    assert oscillating._curves("", {}, of_errors=True) == []
    [values] = oscillating._curves("", {}, of_errors=False)
    assert values.name == "a"
    [errors] = oscillating._curves("", {"fine": quadratic}, of_errors=True)
    assert errors.name == "fine"
    oscillating.plot(folder / "values.png")
    assert (folder / "values.png").stat().st_size > 1000
