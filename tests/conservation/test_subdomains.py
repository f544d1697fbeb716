"""Domain decomposition has the results of a factorisation."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.spinning_sheet import throw
from gossamer_fx.meshes.sheet import sheet

LAW = gx.Miyazaki(
    E=1e9,
    nu=0.3,
    density=1400.0,
    thickness=1e-4,
)


def thrown(mesh: gx.Mesh, subdomains: str | None, held: bool) -> gx.Simulation:
    film = gx.Membrane(mesh, LAW, velocity=throw)
    supports = [gx.Fixed(film, "left")] if held else []
    run = gx.Simulation(gx.Scene(film, *supports), gx.Midpoint(dt=1e-3, subdomains=subdomains))
    run.run(until=4e-3)
    return run


@pytest.mark.mpi
@pytest.mark.parametrize("method, held", [("bddc", False), ("bddc", True), ("fetidp", True)])
def test_a_sheet_in_subdomains_moves_as_the_whole(comm, method, held):
    if comm.size == 1:
        pytest.skip("one rank is not a decomposition")
    mesh = sheet(comm, 6, 6)
    whole = thrown(mesh, None, held)
    parts = thrown(mesh, method, held)
    difference = np.abs(whole.system.q0.array_r - parts.system.q0.array_r).max()
    measured = comm.allreduce(float(difference), op=MPI.MAX)
    # Conjugate gradients stop at a residual of Newton's tolerance.
    assert measured <= 1e-10
    assert parts.totals.energy == pytest.approx(whole.totals.energy, rel=1e-10)
    # At most twenty iterations of the decomposed solver for each of Newton's.
    assert parts.solver.newton.linear_iterations <= 20 * parts.iterations


@pytest.mark.mpi
@pytest.mark.parametrize("method", ["bddc", "fetidp"])
def test_a_wrinkled_sheet_in_subdomains_needs_no_halved_step(comm, method):
    if comm.size == 1:
        pytest.skip("one rank is not a decomposition")
    film = gx.Membrane(sheet(comm, 20, 20), LAW, velocity=throw)
    run = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=4e-3, subdomains=method))
    run.run(until=8e-3)
    assert run.substeps == 0
    assert run.iterations <= 20


def test_a_scene_that_cannot_be_divided_is_refused(comm):
    film = gx.Membrane(sheet(comm, 2, 2), LAW)
    joint = gx.constraints.BallJoint(
        film.port_at(np.array([1.0, 1.0, 0.0])),
        gx.Ground((1.0, 1.0, 0.0)),
        name="hinge",
    )
    with pytest.raises(gx.InputError, match="subdomains"):
        gx.Simulation(gx.Scene(film, joint), gx.Midpoint(dt=1e-3, subdomains="bddc"))
    with pytest.raises(gx.InputError, match="bddc, fetidp"):
        gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3, subdomains="schwarz"))
