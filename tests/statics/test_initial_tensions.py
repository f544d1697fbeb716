"""Tensions that springs, ropes, tapes and films have in the shape in which a scene starts."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import EDGES, sheet
from tests.small_scenes import LINEAR, at_rest

TOP = gx.Ground((0.0, 0.0, 1.0))
BELOW = gx.Ground((0.0, 0.0, -1.0))


@pytest.mark.mpi
def test_springs_and_ropes(comm):
    """A mass in the middle between a rope and a spring of 10 N each stays there."""
    mass = gx.PointMass(1.0, (0.0, 0.0, 0.0), comm=comm)
    rope = gx.connectors.Rope(mass.port(), TOP, stiffness=200.0, initial_tension=10.0, damping=1.0)
    spring = gx.connectors.Spring(BELOW, mass.port(), stiffness=100.0, initial_tension=10.0)
    # A small load, with which the tensions change by less than 0.01 N.
    weight = gx.Gravity(mass, (0.0, 0.0, -0.01))
    equilibrium = at_rest(rope, spring, weight)
    for part in (rope, spring):
        assert gx.probes.Tension(part)(equilibrium) == pytest.approx(10.0, abs=0.01)
    assert gx.probes.Position(mass.port(), "z")(equilibrium) == pytest.approx(-0.01 / 300, rel=1e-6)
    # As a length of 0.95 m.
    same = gx.connectors.Rope(mass.port(), TOP, stiffness=200.0, length=0.95)
    pull = gx.probes.Tension(same)(at_rest(same, spring, weight))
    assert gx.probes.Tension(rope)(equilibrium) == pytest.approx(pull, rel=1e-9)
    bundle = gx.connectors.RopeBundle(
        [(mass.port(), TOP), (mass.port(), BELOW)], stiffness=50.0, initial_tension=5.0
    )
    assert gx.probes.Tension(bundle)(at_rest(bundle, weight)) == pytest.approx(5.0, abs=0.01)
    braked = gx.connectors.Tether(
        mass.port(), TOP, stiffness=200.0, initial_tension=10.0, brake_force=20.0
    )
    held = at_rest(braked, spring, weight)
    assert gx.probes.Tension(braked)(held) == pytest.approx(gx.probes.Tension(rope)(equilibrium))


@pytest.mark.mpi(1)
@pytest.mark.parametrize("strain", ["green", "engineering"])
def test_tapes(comm, strain):
    film = gx.Membrane(sheet(comm, 4, 2), LINEAR, initial_stress=1e5)
    law = gx.CableLaw(2e3, 0.01, strain=strain)
    tape = gx.connectors.Tape.along_edges(film, law, edges="top", initial_tension=30.0)
    across = gx.connectors.Tape.through(
        film,
        law,
        points=[(0, 0.3, 0), (1, 0.3, 0)],
        bars_per_segment=3,
        initial_tension=20.0,
        name="across",
    )
    edges = [gx.Fixed(film, "film", name="all")]
    equilibrium = at_rest(*edges, tape, across)
    assert gx.probes.Tension(tape)(equilibrium) == pytest.approx(30.0, rel=1e-9)
    assert gx.probes.Tension(across)(equilibrium) == pytest.approx(20.0, rel=1e-9)


@pytest.mark.mpi
def test_films_by_a_force_over_a_length(comm):
    """N/t is the stress, also where the thickness varies from cell to cell."""
    thickness = {"thickness": lambda x: 1e-4 * (1 + x[0])}
    for options in ({}, {"properties": thickness}):
        film = gx.Membrane(sheet(comm, 4, 4), LINEAR, initial_tension=100.0, **options)
        equilibrium = at_rest(*(gx.Fixed(film, edge) for edge in EDGES))
        largest = gx.analysis.largest_stress(equilibrium, film).stress
        if not options:
            assert largest == pytest.approx(1e6, rel=1e-9)
        else:
            # At the middles of the cells the thickness is at least that of the first ones.
            assert 0.8e6 < largest < 1e6
    tensor = np.diag([50.0, 20.0, 0.0])
    film = gx.Plate(sheet(comm, 4, 4), LINEAR, initial_tension=tensor)
    equilibrium = at_rest(*(gx.Fixed(film, edge) for edge in EDGES))
    assert gx.analysis.largest_stress(equilibrium, film).stress == pytest.approx(5e5, rel=1e-9)


def test_what_is_given_twice_or_not_at_all_is_refused(comm):
    mass = gx.PointMass(1.0, (0.0, 0.0, 0.0), comm=comm)
    with pytest.raises(gx.InputError, match="length is None and initial_tension is None"):
        gx.connectors.Spring(mass.port(), TOP, stiffness=1.0)
    reel = {"a": mass.port(), "b": TOP, "stiffness": 50.0, "brake_force": 10.0}
    with pytest.raises(gx.InputError, match=r"length is 0\.9 and initial_tension is 5\.0; give"):
        gx.connectors.Tether(**reel, length=0.9, initial_tension=5.0)
    with pytest.raises(gx.InputError, match=r"initial_tension is 10\.5 and brake_force is 10\.0"):
        gx.connectors.Tether(**reel, initial_tension=10.5)
    with pytest.raises(gx.InputError, match=r"total_length is 0\.5 m; give 0\.9 m or more"):
        gx.Scene(gx.connectors.Tether(**reel, initial_tension=5.0, total_length=0.5)).compile()
    with pytest.raises(gx.InputError, match=r"initial_tension is 3.0; give one of them"):
        gx.connectors.Rope(mass.port(), TOP, stiffness=1.0, length=1.0, initial_tension=3.0)
    weak = gx.connectors.Spring(mass.port(), TOP, stiffness=1.0, initial_tension=3.0)
    with pytest.raises(gx.InputError, match="which a stiffness of 1 N/m does not have"):
        gx.Equilibrium(gx.Scene(weak))
    film = gx.Membrane(sheet(comm, 2, 2), LINEAR)
    with pytest.raises(gx.InputError, match="give one of both"):
        gx.connectors.Tape.along_edges(
            film, gx.CableLaw(1e3, 0.01), edges="top", length_factor=0.9, initial_tension=1.0
        )
    with pytest.raises(gx.InputError, match="initial_stress and initial_tension are both given"):
        gx.Membrane(sheet(comm, 2, 2), LINEAR, initial_stress=1.0, initial_tension=1.0)
