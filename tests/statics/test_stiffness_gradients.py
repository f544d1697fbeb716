"""Derivatives of stiffnesses and frequencies in scenes of films, cords, springs and tapes, against
differences of equilibria that are found again."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.sheet import crossed_sheet
from tests.small_scenes import AIR, LINEAR, WRINKLING, at_rest

TIGHT = gx.analysis.Continuation(tolerance=1e-12)
CABLES = [
    gx.CableLaw(2e3, 0.01),
    gx.TensionOnly(2e3, 0.01),
    gx.CableLaw(2e3, 0.01, strain="engineering"),
    gx.TensionOnly(2e3, 0.01, strain="engineering"),
]


def taped(comm, *, cable=CABLES[0], EA=2e3, μ=0.01, cut=0.998, k=300.0, length=0.2, g=-9.81):
    """A film on three corners, with weight, a tape along its free edge and a spring at the fourth
    one."""
    law = gx.Miyazaki(1e9, 0.3, density=1400.0, thickness=1e-4, residual_stiffness=0.1)
    film = gx.Membrane(crossed_sheet(comm, 4, 4), law, initial_stress=5e5, name="film")
    tape = gx.connectors.Tape.along_edges(
        film,
        type(cable)(EA, μ, strain=cable.strain),
        edges="top",
        length_factor=cut,
        name="tape",
    )
    held = [gx.Fixed(film, edge) for edge in ("left", "bottom")]
    corner = film.port("top right")
    spring = gx.connectors.Spring(
        corner, gx.Ground((1.2, 1.2, 0.1)), stiffness=k, length=length, name="spring"
    )
    load = gx.loads.Force(corner, (0.0, 0.0, 0.5), name="load")
    sensor = gx.connectors.AttachedMass(film.port_at((0.75, 0.75, 0.0)), 5e-3, name="sensor")
    weight = gx.Gravity(film, (0.0, 0.0, g), name="weight")
    return corner, tape, at_rest(*held, tape, spring, load, sensor, weight, search=TIGHT)


# By the name of the variable: the argument, its value, and the value of the variable.
BY = {
    "tape.EA": ("EA", 2e3, 2e3),
    "tape.length_scale": ("cut", 0.998, 1.0),
    "spring.stiffness": ("k", 300.0, 300.0),
    "tape.line_density": ("μ", 0.01, 0.01),
    "spring.length": ("length", 0.2, 0.2),
    "weight.g": ("g", -9.81, -9.81),
}


def results_of(corner, tape, equilibrium):
    return {
        "height": gx.probes.Position(corner, "z"),
        "stiffness": gx.analysis.PointStiffness(equilibrium, corner, direction=(1.0, 0.0, 1.0)),
        "frequency": gx.analysis.Frequency(equilibrium),
        "energy": gx.analysis.Energy(),
    }


@pytest.mark.mpi(2)
@pytest.mark.parametrize("cable", CABLES)
def test_results_of_a_taped_film(comm, cable):
    corner, tape, equilibrium = taped(comm, cable=cable)
    results = results_of(corner, tape, equilibrium)
    gradients = {}
    for name, one in results.items():
        gradients[name] = gx.analysis.gradient(equilibrium, of=one, by=list(BY))
    for variable, (argument, given, value) in BY.items():
        step = 1e-5 * given
        found = []
        for sign in (1, -1):
            other = taped(comm, cable=cable, **{argument: given + sign * step})
            found.append({name: one(other[2]) for name, one in results_of(*other).items()})
        for name, gradient in gradients.items():
            # Relative to the value: of the scale of a length 1.
            expected = (found[0][name] - found[1][name]) / (2e-5 * value)
            scale = abs(gradient.value / value)
            # Of the acceleration of gravity the component along z.
            assert gradient[variable].values[-1] == pytest.approx(
                expected, rel=1e-4, abs=1e-6 * scale
            ), (name, variable)


@pytest.mark.mpi
def test_a_length_that_changes_a_mass_has_no_gradient_in_a_run(comm):
    film = gx.Membrane(
        crossed_sheet(comm, 2, 2), LINEAR, velocity=lambda X: X * [[0.3], [0.1], [0.0]], name="film"
    )
    tape = gx.connectors.Tape.along_edges(film, CABLES[0], edges="top", name="tape")
    run = gx.Simulation(gx.Scene(tape), gx.Midpoint(dt=1e-3))
    recorded = gx.analysis.RunTape(run)
    run.run(until=2e-3)
    point = gx.probes.Position(film.port("top left"), "x")
    gx.analysis.gradient(recorded, of=point, by=["tape.EA"])
    with pytest.raises(gx.InputError, match=r"'tape.length_scale' changes a mass"):
        gx.analysis.gradient(recorded, of=point, by=["tape.length_scale"])


def test_the_lengths_of_a_tape_follow_its_scale(comm):
    """As in a search for a minimum: strains are those of the present natural lengths."""
    film = gx.Membrane(crossed_sheet(comm, 2, 2), WRINKLING, initial_stress=1e5, name="film")
    tape = gx.connectors.Tape.along_edges(film, CABLES[0], edges="top", name="tape")
    edges = [gx.Fixed(film, name) for name in ("left", "right", "top", "bottom")]
    equilibrium = at_rest(*edges, tape)
    pull = gx.probes.Tension(tape)
    assert pull(equilibrium) == pytest.approx(0.0, abs=1e-9)
    found = gx.analysis.minimise(
        equilibrium,
        of=gx.analysis.Energy(),
        by=["tape.length_scale"],
        bounds={"tape.length_scale": (0.9, 0.9975)},
    )
    scale = float(found.parameters["tape.length_scale"][0])
    assert scale == pytest.approx(0.9975)
    λ = 1 / scale
    assert pull(equilibrium) == pytest.approx(2e3 * (λ**2 - 1) / 2 * λ, rel=1e-6)


def test_gas_and_contact_are_refused(comm):
    bag = gx.Membrane(airbag(comm, 1.0, 4), LINEAR, initial_stress=1e6, name="film")
    gas = gx.Chamber(bag, gas=AIR, pressure=1e3, temperature=300.0, dead_volume=0.02)
    equilibrium = at_rest(gx.Fixed(bag, "bottom"), gas)
    middle = bag.port_at((0.4, 0.4, 0.0))
    stiffness = gx.analysis.PointStiffness(equilibrium, middle)
    assert stiffness(equilibrium) > 0
    with pytest.raises(gx.InputError, match="has gas chambers, by whose state it is not derived"):
        gx.analysis.gradient(equilibrium, of=stiffness, by=["film.initial_stress"])
    held = gx.analysis.PointStiffness(
        equilibrium, bag.port_at((0.4, 0.4, 0.0)), direction=(1, 0, 0)
    )
    assert np.isfinite(held(equilibrium))
