"""A film that vibrates undamped under the pressure of its gas is warned of; one that does not is
not."""

from __future__ import annotations

import logging
from dataclasses import replace

import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.revolved import balloon
from gossamer_fx.presets.films import KAPTON_HN
from gossamer_fx.presets.gases import NITROGEN
from gossamer_fx.records.run.undamped_films import UndampedFilms
from tests.small_scenes import run_of

WORDS = "nothing damps it"
RADIUS = 0.1
PRESSURE = 2e3


def sphere(comm, stretch: float, *, damped: bool = False, law=None):
    """A balloon under pressure that starts stretched [-]; at rest that is p r (1 - ν)/(2 E t)."""
    law = law or KAPTON_HN.law(25e-6)
    film = gx.Membrane(
        balloon(comm, RADIUS, 8, 2), law, displacement=lambda X: stretch * X, name="balloon"
    )
    bag = gx.Chamber(film, gas=NITROGEN, pressure=PRESSURE, temperature=293.0)
    items = [film, bag]
    if damped:
        items.append(gx.Damping(film, stiffness_factor=1e-9))
    return run_of(*items, dt=1e-6)


AT_REST = PRESSURE * RADIUS * (1 - KAPTON_HN.nu) / (2 * KAPTON_HN.E * 25e-6)


@pytest.mark.mpi
def test_a_film_that_vibrates_is_named_once_with_the_remedy(comm, caplog) -> None:
    """It starts without strain: the pressure throws it to twice the strain at rest, whose energy is
    four thirds of the estimate; a tenfold pressure that is let off leaves a hundredfold energy."""
    run = sphere(comm, 0.0)
    with caplog.at_level(logging.WARNING, "gossamer_fx"):
        run.run(until=1e-5)
    assert WORDS not in caplog.text
    film = run.system.unknowns.bodies[0]
    # As if it had been thrown: the velocities of a breathing vibration.
    x = run.system.unknowns.state[film].positions()
    run.system.unknowns.v0.array[:] = (40.0 * x / RADIUS).ravel()
    with caplog.at_level(logging.WARNING, "gossamer_fx"):
        run.run(until=4e-5)
        run.run(until=5e-5)
    found = [record.getMessage() for record in caplog.records if WORDS in record.getMessage()]
    if comm.rank == 0:
        [words] = found
        assert "'balloon'" in words and "gx.loads.flat_damping(film" in words
        assert not words.endswith("..")


def test_the_energy_at_rest_is_estimated_to_a_factor_of_three(comm) -> None:
    """Of a sphere it is a third of the estimate, (3 p V)²/(2 E t A)."""
    run = sphere(comm, AT_REST)
    nothing = replace(run.totals, stored={})
    [ratio] = UndampedFilms(run.system)._ratios(nothing, run.totals).values()
    assert ratio == pytest.approx((1 - KAPTON_HN.nu) / 2, rel=0.1)


@pytest.mark.parametrize("damped", [False, True])
def test_film_at_rest_or_with_damping_is_not_warned_of(comm, caplog, damped: bool) -> None:
    run = sphere(comm, 0.0 if damped else AT_REST, damped=damped)
    film = run.system.unknowns.bodies[0]
    if damped:
        x = run.system.unknowns.state[film].positions()
        run.system.unknowns.v0.array[:] = (40.0 * x / RADIUS).ravel()
    with caplog.at_level(logging.WARNING, "gossamer_fx"):
        run.run(until=3e-5)
    assert WORDS not in caplog.text


def test_a_scene_without_gas_imports_nothing_for_it(comm) -> None:
    film = gx.Membrane(balloon(comm, RADIUS, 8, 2), KAPTON_HN.law(25e-6))
    run = run_of(film, dt=1e-6)
    run.run(until=2e-6)
    assert run._undamped is None
