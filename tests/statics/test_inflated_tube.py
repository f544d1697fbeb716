"""A tube under pressure, whole and free in space, and bent until it wrinkles."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from demos.studies import bent_tube, inflated_tube
from gossamer_fx.meshes.tube_section import capped_cylinder, cylinder
from gossamer_fx.records.fields.film_states import STATES
from tests.small_scenes import at_rest


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


@pytest.mark.mpi(1)
@pytest.mark.parametrize("element", ["P1", "P2"])
def test_bent_tube_wrinkles_at_the_moment_of_stein_and_hedgepeth(comm, element):
    result = bent_tube.problem(comm, element, 16)
    assert result["M(½κ_w)/exact"] == pytest.approx(1, abs=5e-3)
    assert result["M_w/exact"] == pytest.approx(1, abs=3e-2)
    for ratio in bent_tube.BENT:
        assert result[f"M({ratio:g}κ_w)/exact"] == pytest.approx(1, abs=1e-2)
    assert result["residual"] < 1e-8


@pytest.mark.parametrize(("order", "error"), [(1, 0.03), (2, 1e-3)])
def test_normals_of_the_cylinder_point_outwards(comm, order, error):
    mesh = capped_cylinder(comm, 1.0, 2.0, 16, 8, order)
    # 2π of a cylinder of radius 1 and length 2; a polygon misses 3 %.
    assert mesh.enclosed_volume() == pytest.approx(6.283185, rel=error)


def taut_share(comm, hoop_strain, mesh_order):
    """Share of the nodes of cells that are taut, in an inflated tube of constant length with eight
    cells around."""
    radius = 0.1
    law = gx.TensionField(E=1e9, nu=0.3, density=1000.0, thickness=1e-4)
    film = gx.Membrane(cylinder(comm, radius, 0.2, 8, 2, mesh_order), law, order=2)
    pressure = hoop_strain * law.E * law.thickness / (1 - law.nu**2) / radius
    supports = [
        gx.Fixed(film, "wall", components=(0,)),
        gx.Fixed(film, "top", components=(1,)),
        gx.Fixed(film, "bottom", components=(1,)),
        gx.Fixed(film, "left", components=(2,)),
        gx.Fixed(film, "right", components=(2,)),
    ]
    inflated = at_rest(film, gx.Pressure(film, pressure), *supports)
    _, states = gx.fields.field_values(inflated, film, field="state")
    taut = np.array([(states > STATES["taut"] - 0.5).sum(), len(states)])
    found, points = comm.allreduce(taut)
    return found / points


def test_a_flat_side_that_becomes_a_parabola_loses_tension_in_its_middle(comm):
    """Along a parabola over a side of the angle θ the hoop strain varies from θ²/24 below its mean
    to θ²/12 above it, so that tubes with smaller strains are not taut.  Curved cells are arcs."""
    threshold = (math.pi / 4) ** 2 / 24
    assert taut_share(comm, 1.5 * threshold, mesh_order=1) == 1
    assert taut_share(comm, 0.7 * threshold, mesh_order=1) < 0.9
    assert taut_share(comm, 0.1 * threshold, mesh_order=2) == 1
