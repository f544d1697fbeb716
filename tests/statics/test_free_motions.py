"""Results of equilibria in which something moves freely: right where they do not depend on it, and
refused by the name of the motion where they do."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.airbag import airbag
from tests.small_scenes import AIR

PRESSURE = 200.0  # Pa


def inflated(comm, is_held, *others):
    """A square airbag under a pressure, without supports or with the least that holds it."""
    law = gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=25e-6, residual_stiffness=1e-3)
    film = gx.Membrane(airbag(comm, 1.0, 6), law, name="film")
    held = []
    if is_held:
        held = [
            gx.Fixed(film, "seam", components=(2,), name="plane"),
            gx.Fixed(film, "corner", components=(0, 1)),
            gx.Fixed(film, "right corner", components=(1,)),
        ]
    top = film.port_at((0.0, 0.0, 0.0), snap=True)
    items = [make(film, top) for make in others]
    equilibrium = gx.Equilibrium(gx.Scene(film, gx.Pressure(film, PRESSURE), *held, *items))
    equilibrium.find()
    return equilibrium, film, top


@pytest.mark.mpi
def test_a_free_balloon_has_the_derivatives_of_a_held_one(comm):
    by = ["pressure.pressure", "film.thickness"]
    found = []
    for is_held in (True, False):
        equilibrium, film, _ = inflated(comm, is_held)
        assert equilibrium.result.regular == is_held
        results = (gx.analysis.EnclosedVolume(film), gx.analysis.Energy())
        found.append([gx.analysis.gradient(equilibrium, of=each, by=by) for each in results])
    for held, free in zip(*found, strict=True):
        assert held.notes == ()
        assert "nothing resists translation x, translation y, translation z" in free.notes[0]
        for name in by:
            np.testing.assert_allclose(free[name].values, held[name].values, rtol=1e-8)


def test_what_depends_on_a_free_motion_is_refused_by_its_name(comm):
    equilibrium, _, top = inflated(
        comm, False, lambda _, port: gx.loads.Force(port, (0.0, 0.0, 0.0), name="push")
    )
    height = gx.probes.Position(top, "z")
    with pytest.raises(gx.InputError, match=r"Position is not determined .* resists translation x"):
        gx.analysis.gradient(equilibrium, of=height, by=["pressure.pressure"])
    with pytest.raises(gx.InputError, match=r"stiffness of the point is not .* translation x"):
        gx.analysis.point_stiffness(equilibrium, top)
    # Nothing balances such a force.
    with pytest.raises(gx.InputError, match=r"'push\.force' leaves the scene without equilibrium"):
        gx.analysis.gradient(equilibrium, of=gx.analysis.Energy(), by=["push.force"])


def test_a_path_along_which_something_moves_freely_is_refused_by_its_name(comm):
    equilibrium, _, _ = inflated(comm, False)
    with pytest.raises(gx.InputError, match=r"path: nothing resists translation x, .* hold it by"):
        gx.analysis.path(equilibrium, 2.0, by="pressure.pressure", start=1.0)


def test_a_rigid_motion_has_no_frequency(comm):
    equilibrium, _, _ = inflated(comm, False)
    frequency = gx.analysis.Frequency(equilibrium)
    with pytest.raises(gx.InputError, match=r"mode 0 has .* zero within round-off"):
        gx.analysis.gradient(equilibrium, of=frequency, by=["film.thickness"])


@pytest.mark.parametrize(("process", "exponent"), [("adiabatic", 1.4), ("isothermal", 1.0)])
def test_gas_alone_holds_a_piston(comm, process, exponent):
    """Without springs the tangent without the gas is zero."""
    mass = gx.PointMass(0.5, comm=comm)
    piston = gx.gas.Piston(mass.port(), 0.01, direction=(1.0, 0.0, 0.0))
    outside = gx.gas.Ambient(8e4, 300.0)
    chamber = gx.Chamber(
        piston, gas=AIR, pressure=1e5, temperature=300.0, dead_volume=2e-3, outside=outside
    )
    across = [
        gx.connectors.AxialSpring(mass.port(), 1e3, direction=tuple(axis), name=name)
        for axis, name in zip(np.eye(3)[1:], "yz", strict=True)
    ]
    equilibrium = gx.Equilibrium(gx.Scene(mass, chamber, *across), gas=process)
    equilibrium.find()
    gas = equilibrium.chamber("chamber")
    stiffness = gx.analysis.point_stiffness(equilibrium, mass.port(), direction=(1.0, 0.0, 0.0))
    assert stiffness == pytest.approx(exponent * gas.pressure * 0.01**2 / gas.volume, rel=1e-9)


def test_a_search_at_several_loads_warns_once_of_what_moves_freely(caplog) -> None:
    """And again if something else does."""
    ball = gx.PointMass(1.0, comm=MPI.COMM_SELF, name="ball")
    equilibrium = gx.Equilibrium(gx.Scene(ball))
    for load in (0.5, 1.0, 1.5):
        assert equilibrium.find(at=load).free
    assert caplog.text.count("The equilibrium is not unique") == 1
    gx.Equilibrium(gx.Scene(ball)).find()
    assert caplog.text.count("The equilibrium is not unique") == 2
