"""A contact stiffness that is too soft for the impact is reported, once."""

from __future__ import annotations

import logging

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.contact.active_set import StiffnessWarning
from tests.contact.scenes import SIGMA, film, simulate

COMM = MPI.COMM_SELF


def test_a_stiffness_that_is_too_soft_is_reported_once(caplog) -> None:
    lower = film(COMM, 1, name="lower")
    upper = film(COMM, 1, height=1.2e-3, velocity=(0, 0, -2.0), turn=0.4, name="upper")
    with caplog.at_level(logging.WARNING, logger="gossamer_fx"):
        simulate([gx.Contact(lower, upper, distance=1e-3, stiffness=1e6)], 3e-4)
    (message,) = [r.getMessage() for r in caplog.records if "too soft" in r.getMessage()]
    least = 4 * SIGMA * 2.0**2 / 1e-3**2
    assert "1e+06 N/m³ is too soft to stop 'lower' and 'upper', which close at 2 m/s" in message
    assert f"give {least:.2g} N/m³ at least, or leave it out." in message


def test_films_that_do_not_meet_are_not_reported(caplog) -> None:
    with caplog.at_level(logging.WARNING, logger="gossamer_fx"):
        films = [film(COMM, 1), film(COMM, 1, height=2e-3, name="two")]
        simulate([gx.Contact(*films, distance=1e-3, stiffness=1.0)], 1e-4)
    assert not caplog.records


def test_without_pairs_there_is_no_warning() -> None:
    warning = StiffnessWarning(1.0, ["a", "b"], COMM)
    warning.check(1.0, np.zeros((0, 2), np.int32), np.zeros(0), np.zeros(0))
    assert not warning.was_given
    warning.check(1.0, np.array([[0, 1]], np.int32), np.array([1.0]), np.array([1.0]))
    assert warning.was_given


def test_a_stiffness_that_a_parameter_has_changed_is_the_one_that_is_reported(caplog) -> None:
    floor = gx.contact.Plane(point=(0.0, 0.0, -1.2e-3), normal=(0.0, 0.0, 1.0), name="floor")
    contact = gx.Contact(film(COMM, 1, velocity=(0, 0, -2.0)), floor, distance=1e-3, stiffness=1e9)
    run = gx.Simulation(gx.Scene(contact), gx.Midpoint(dt=1e-4))
    with caplog.at_level(logging.WARNING, logger="gossamer_fx"):
        (compiled,) = run.system.equations.active_sets
        (parameter,) = [one for one in contact._parameters() if one.name == "stiffness"]
        compiled.set_number(compiled._term, str(parameter.source), np.array([2e5]))
        run.run(until=3e-4)
    assert "a stiffness of 2e+05 N/m³ is too soft" in caplog.text
