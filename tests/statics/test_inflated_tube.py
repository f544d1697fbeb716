"""A tube under pressure, whole and free in space, and bent until it wrinkles."""

from __future__ import annotations

import pytest
import ufl
from dolfinx import fem

import gossamer_fx as gx
from demos.studies import bent_tube, inflated_tube
from gossamer_fx.forms.kinematics import area_vector
from gossamer_fx.meshes.tube_section import capped_cylinder


@pytest.mark.mpi
@pytest.mark.parametrize("q", [1e-2, 5e-2])
# The tolerances are the errors of a polygon of 32 sides, and of one of 12 with curved sides.
@pytest.mark.parametrize(("element", "sides", "tolerance"), [("P1", 32, 1e-3), ("P2", 12, 5e-5)])
def test_stretches_of_a_closed_tube(comm, element, q, sides, tolerance):
    result = inflated_tube.problem(comm, element, q, sides)
    λ_x, λ_t = inflated_tube.exact(q)
    assert result["λ_x"] == pytest.approx(λ_x, rel=tolerance)
    assert result["λ_t"] == pytest.approx(λ_t, rel=tolerance)
    assert result["residual"] < 1e-8
    assert result["iterations"] < 40


def test_exact_stretches_are_those_of_the_literature():
    # Published stretches, eight decimals.
    assert inflated_tube.exact(0.01) == pytest.approx((1.00206617, 1.00846251), abs=1e-8)
    assert inflated_tube.exact(0.05) == pytest.approx((1.01157565, 1.04166588), abs=1e-8)


@pytest.mark.mpi
@pytest.mark.parametrize("element", ["P1", "P2"])
def test_bent_tube_wrinkles_at_the_moment_of_stein_and_hedgepeth(comm, element):
    result = bent_tube.problem(comm, element, 16)
    assert result["M(½κ_w)/exact"] == pytest.approx(1, abs=5e-3)
    assert result["M_w/exact"] == pytest.approx(1, abs=3e-2)
    for ratio in bent_tube.BENT:
        measured = result[f"M({ratio:g}κ_w)/exact"]
        assert measured == pytest.approx(1, abs=1e-2)
    assert result["residual"] < 1e-8


@pytest.mark.mpi
@pytest.mark.parametrize(("order", "error"), [(1, 0.03), (2, 1e-3)])
def test_normals_of_the_cylinder_point_outwards(comm, order, error):
    film = gx.Membrane(
        capped_cylinder(
            comm,
            1.0,
            2.0,
            16,
            8,
            order,
        ),
        inflated_tube.LAW,
        order=order,
    )
    x = fem.Function(film.space)
    x.interpolate(lambda X: X)
    volume = fem.assemble_scalar(
        fem.form(ufl.dot(x, area_vector(film.deformation(x))) / 3 * film.dx)
    )
    # 2π of a cylinder of radius 1 and length 2; a polygon misses 3 %.
    assert comm.allreduce(volume) == pytest.approx(6.283185, rel=error)
