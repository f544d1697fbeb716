"""Meshes displaced by a mode, whose paths bend from the start."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import crossed_sheet, sheet
from tests.small_scenes import LINEAR, at_rest

LENGTH = 1.0
SECTION = gx.sections.rectangle(0.01, 0.02, E=1e9, nu=0.3, density=1000.0)
EULER = math.pi**2 * min(SECTION.EI2, SECTION.EI3) / LENGTH**2


def column(mesh):
    """A column between a fixed and a sliding hinge, which bends in the plane in which it is soft,
    and the port at its middle."""
    beam = gx.Beam(mesh, SECTION, normal=(0.0, 0.0, 1.0), name="column")
    supports = [
        gx.Fixed(beam, "start"),
        gx.Fixed(beam, "end", components=(1, 2)),
        gx.Fixed(beam, "line", components=(1,), name="plane"),
    ]
    push = gx.loads.Force(beam.port("end"), lambda t: (-t * EULER, 0.0, 0.0), name="push")
    return beam, gx.Equilibrium(gx.Scene(*supports, push))


@pytest.mark.mpi
def test_a_crooked_column_bends_from_the_start(comm):
    """w0/(1 - P/P_E) of a column with the imperfection w0 sin(π x/L), for small deflections."""
    w0 = 1e-4
    beam, equilibrium = column(line(comm, [(0, 0, 0), (LENGTH, 0, 0)], 16))
    equilibrium.find()
    mode = next(one for one in gx.analysis.modes(equilibrium, 4) if one.effective_mass[2] > 1e-3)
    crooked = gx.analysis.imperfect_mesh(beam, mode, amplitude=w0)
    # The other mesh stays as it is.
    assert np.abs(beam.mesh.domain.geometry.x[:, 2]).max() == 0
    bent, equilibrium = column(crooked)
    middle = gx.probes.Position(bent.port_at((LENGTH / 2, 0.0, w0)), "z")
    found = gx.analysis.path(equilibrium, 0.8, probes={"z [m]": middle})
    exact = w0 / (1 - found.loads)
    assert middle(equilibrium) > 4.5 * w0
    np.testing.assert_allclose(found.columns["z [m]"], exact, rtol=0.02)
    assert found.branch_points == () and found.limit_points == ()


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
def test_a_film_in_the_shape_of_its_first_mode(comm, order):
    """A square: sin(π x) sin(π y), with the amplitude, groups and area of the mode's shape."""
    film = gx.Membrane(crossed_sheet(comm, 8, 8), LINEAR, order=order, initial_stress=1e6)
    edges = ("left", "right", "bottom", "top")
    equilibrium = at_rest(*[gx.Fixed(film, edge) for edge in edges])
    (mode,) = gx.analysis.modes(equilibrium, 1)
    bent = gx.analysis.imperfect_mesh(film, mode, amplitude=0.01)
    x, y, z = bent.domain.geometry.x.T
    assert comm.allreduce(float(np.abs(z).max()), MPI.MAX) == pytest.approx(0.01)
    np.testing.assert_allclose(np.abs(z), 0.01 * np.sin(np.pi * x) * np.sin(np.pi * y), atol=5e-4)
    other = gx.Membrane(bent, LINEAR, name="bent")
    # Free of stress where it is.
    still = at_rest(*[gx.Fixed(other, edge) for edge in edges])
    assert still.totals.stored["bent"] < 1e-12
    assert set(bent.groups) == set(film.mesh.groups)


def test_modes_of_other_scenes_are_refused(comm):
    film = gx.Membrane(sheet(comm, 2, 2), LINEAR)
    with pytest.raises(gx.InputError, match="the mode has no displacements of 'film'"):
        gx.analysis.imperfect_mesh(film, gx.analysis.Mode(1.0, 0.0, np.zeros(3)), amplitude=1.0)
    nodes = film.space.dofmap.index_map.size_local
    still = gx.analysis.Mode(
        1.0, 0.0, np.zeros(3 * nodes), displacements={"film": np.zeros((nodes, 3))}
    )
    with pytest.raises(gx.InputError, match="'film' does not move in the mode"):
        gx.analysis.imperfect_mesh(film, still, amplitude=1.0)
