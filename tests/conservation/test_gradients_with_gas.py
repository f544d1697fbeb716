"""Gradients through steps with gas: energy taken back to the start, remainders, times of
crossings."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.design import opening_time
from gossamer_fx.mechanics.gas.ring import Loop
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.presets.gases import NITROGEN
from tests.rates import observed_order

# Derivatives of remainders need states that are solved to round-off.
SOLVED = gx.Tolerances(relative=1e-13)
ELASTIC = {"E": 1e8, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
CONTENTS = {"gas": NITROGEN, "temperature": 293.0}


def waves(X):
    return np.vstack([np.sin(15 * X[0]), np.sin(9 * X[1]), np.sin(11 * X[0])])


def airbag_from_a_tank(comm, law=None, area=5e-5, coefficient=0.8, tank=3e4, volume=4e-4, p=1e3):
    """A quarter of an airbag that a tank blows up through an orifice, choked at first; free in
    space."""
    film = gx.Membrane(airbag(comm, edge=0.2, cells=4), law or gx.Linear(**ELASTIC), velocity=waves)
    bag = gx.Chamber(film, pressure=p, dead_volume=1e-3, name="bag", **CONTENTS)
    bottle = gx.Tank(volume, pressure=tank, **CONTENTS)
    inlet = gx.Orifice(bottle, bag, area=area, discharge_coefficient=coefficient, name="inlet")
    return gx.Scene(film, bag, inlet), 2e-4, 30


def airbag_with_a_valve(comm, factor=1.0):
    """The same airbag, whose orifice opens and closes again."""
    return airbag_from_a_tank(
        comm, area=lambda t: factor * 5e-5 * np.sin(np.pi * min(t / 5e-3, 1.0)) ** 2
    )


def tube_with_a_ring(comm, area=1e-5, coefficient=0.8, thickness=1e-4):
    """Two compartments of a flat tube; gas passes between them through a ring that opens and
    closes."""
    law = gx.Linear(E=1e8, nu=0.3, density=1400.0, thickness=thickness)
    film = gx.Membrane(
        flat_tube(comm, 0.3, 0.06, 4, compartments=2),
        law,
        displacement=lambda X: np.vstack(
            [0 * X[0], 0 * X[0], 4e-3 * np.sin(np.pi * X[0] / 0.3) * np.cos(np.pi * X[1] / 0.1)]
        ),
        velocity=lambda X: np.vstack([-3 * X[1], 3 * X[0] + 0.5, 0.2 + 5 * X[1]]),
    )
    ring = gx.gas.Ring(film, "ring 1")
    first, second = (
        gx.Chamber(
            film,
            pressure=200.0,
            dead_volume=1e-5,
            surface=(f"compartment {i}",),
            rings=(ring,),
            name=f"compartment {i}",
            **CONTENTS,
        )
        for i in (1, 2)
    )
    tank = gx.Tank(1e-5, pressure=1e5, **CONTENTS)
    inlet = gx.Orifice(tank, first, area=area, name="inlet")
    passage = gx.Orifice(
        first, second, area=ring, discharge_coefficient=coefficient, name="passage"
    )
    return gx.Scene(film, inlet, passage), 1e-4, 30


def test_a_ring_that_starts_without_area_opens_in_no_direction(comm):
    """A tube that is pressed flat: the area of its ring has no direction, and no derivative."""
    law = gx.Linear(E=1e8, nu=0.3, density=1400.0, thickness=1e-4)
    film = gx.Membrane(flat_tube(comm, 0.3, 0.06, 4, compartments=2), law)
    ring = gx.gas.Ring(film, "ring 1")
    first, second = (
        gx.Chamber(
            film,
            pressure=pressure,
            dead_volume=1e-5,
            surface=(f"compartment {i}",),
            rings=(ring,),
            name=f"compartment {i}",
            **CONTENTS,
        )
        for i, pressure in ((1, 200.0), (2, 100.0))
    )
    passage = gx.Orifice(first, second, area=ring, name="passage")
    run = gx.Simulation(gx.Scene(film, passage), gx.Midpoint(dt=1e-4))
    assert gx.probes.RingArea(ring)(run) < 1e-16
    loop = Loop(ring, run.system.equations.compiled[0]._system)
    assert not loop.aperture_gradient(run.stepper.dt).any()
    tape = gx.analysis.RunTape(run)
    run.run(until=3e-4)
    found = gx.analysis.gradient(
        tape, of=gx.analysis.ChamberPressure(second), by=["film.thickness", "film.initial_velocity"]
    )
    assert all(np.isfinite(one.values).all() for one in found)


def cylinder_with_a_piston(
    comm,
    conductance=0.05,
    wall=400.0,
    supply=1.4e5,
    supply_temperature=350.0,
    outside=9e4,
    pressure=1e5,
    dead_volume=2e-3,
):
    """A piston between a gas and the surroundings; the gas is supplied, heated and leaks."""
    mass = gx.PointMass(0.4, (0.0, 0.0, 0.0), name="mass")
    air = gx.gas.Ambient(outside, 293.0, name="air")
    cylinder = gx.Chamber(
        gx.gas.Piston(mass.port(), area=0.01, direction=(1.0, 0.0, 0.0)),
        pressure=pressure,
        dead_volume=dead_volume,
        outside=air,
        name="cylinder",
        **CONTENTS,
    )
    bottle = gx.gas.Ambient(supply, supply_temperature, name="bottle")
    scene = gx.Scene(
        mass,
        gx.gas.WallHeat(cylinder, conductance, temperature=wall),
        gx.Orifice(bottle, cylinder, area=2e-5, name="inlet"),
        gx.Orifice(cylinder, air, area=1e-5, name="leak"),
    )
    return scene, 1e-3, 25


def recorded(make: Callable[..., Any], comm, **changes):
    scene, h, steps = make(comm, **changes)
    run = gx.Simulation(scene, gx.Midpoint(dt=h, tolerances=SOLVED))
    tape = gx.analysis.RunTape(run)
    run.run(until=steps * h)
    return run, tape


def wrinkling(comm):
    law = gx.Miyazaki(**ELASTIC, residual_stiffness=1e-2)
    return airbag_from_a_tank(comm, law=law)


# Largest deviation over the largest entry; a film that wrinkles amplifies round-off.
CONSERVING = {airbag_from_a_tank: 1e-10, tube_with_a_ring: 1e-9, wrinkling: 1e-6}


@pytest.mark.mpi(1)
@pytest.mark.parametrize("make", CONSERVING, ids=lambda make: make.__name__)
def test_the_gradient_of_the_last_energy_is_that_of_the_first(comm, make):
    """Film and gas conserve their energy from every start, so E(T) and E(0) are one function of it.

    At given p and T at the start, the gas has U = p V/(γ - 1), whatever flows later.
    """
    run, tape = recorded(make, comm)
    system = run.system
    film = system.unknowns.bodies[0]
    names = [f"{film.name}.initial_velocity", f"{film.name}.initial_position", "tank.pressure"]
    names += ["tank.volume", "inlet.area", "tank.temperature"]
    found = gx.analysis.gradient(tape, of=gx.analysis.Energy(), by=names)
    tape.restore(tape.states[0])
    owned = system.unknowns.block(film).owned
    momenta = system.unknowns.numbering.vector()
    system.unknowns.M.mult(system.unknowns.v0, momenta)
    by_position = system.equations.stored_forces().array_r.copy()
    for gas in system.equations.scalar_unknowns[0].states().values():
        if gas.enclosure is not None:
            by_position += gas.pressure / (NITROGEN.gamma - 1) * gas.enclosure.of_volume
    for name, exact in zip(names, (momenta.array_r, by_position), strict=False):
        largest = comm.allreduce(np.abs(exact[owned]).max(initial=0.0), op=MPI.MAX)
        error = np.abs(found[name].values - exact[owned]).max(initial=0.0)
        assert error < CONSERVING[make] * largest, name
    tank = run.chamber("tank")
    # U = p V/(γ - 1) with γ - 1 = 0.4.
    rel = CONSERVING[make]
    assert found["tank.pressure"].values[0] == pytest.approx(tank.volume / 0.4, rel=rel)
    assert found["tank.volume"].values[0] == pytest.approx(tank.pressure / 0.4, rel=rel)
    energy = found.value
    # Energy at the start depends neither on the orifice nor on the temperature at given p and V.
    assert abs(found["inlet.area"].values[0]) * 1e-5 < 1e-10 * energy
    assert abs(found["tank.temperature"].values[0]) * 293.0 < 1e-10 * energy


def pressure_of(run, name: str) -> gx.analysis.ChamberPressure:
    return gx.analysis.ChamberPressure(run.chamber(name).chamber)


# Result, parameter, and the argument of the scene that it is.
PARAMETERS = [
    (airbag_from_a_tank, "bag", "inlet.area", "area", 5e-5),
    (tube_with_a_ring, "compartment 2", "passage.discharge_coefficient", "coefficient", 0.8),
    (airbag_from_a_tank, "bag", "inlet.discharge_coefficient", "coefficient", 0.8),
    (airbag_from_a_tank, "bag", "tank.pressure", "tank", 3e4),
    (airbag_from_a_tank, "bag", "tank.volume", "volume", 4e-4),
    (airbag_from_a_tank, "bag", "bag.pressure", "p", 1e3),
    (airbag_with_a_valve, "bag", "inlet.area_factor", "factor", 1.0),
    (tube_with_a_ring, "compartment 2", "film.thickness", "thickness", 1e-4),
    (tube_with_a_ring, "compartment 2", "inlet.area", "area", 1e-5),
    (cylinder_with_a_piston, "cylinder", "wall.conductance", "conductance", 0.05),
    (cylinder_with_a_piston, "cylinder", "wall.temperature", "wall", 400.0),
    (cylinder_with_a_piston, "cylinder", "bottle.pressure", "supply", 1.4e5),
    (cylinder_with_a_piston, "cylinder", "bottle.temperature", "supply_temperature", 350.0),
    (cylinder_with_a_piston, "cylinder", "air.pressure", "outside", 9e4),
    (cylinder_with_a_piston, "cylinder", "cylinder.pressure", "pressure", 1e5),
    (cylinder_with_a_piston, "cylinder", "cylinder.dead_volume", "dead_volume", 2e-3),
]


@pytest.mark.parametrize("make", [airbag_from_a_tank, airbag_with_a_valve, cylinder_with_a_piston])
def test_a_parameter_has_the_value_that_the_scene_gives_it(comm, make):
    """One, the factor of a function, where a function of time gives the area."""
    scene, dt, _ = make(comm)
    run = gx.Simulation(scene, gx.Midpoint(dt=dt))
    adjoint = run.system.equations.scalar_unknowns[0].adjoint()
    openings = [item for item in scene.items if isinstance(item, gx.Orifice)]
    ends = [end for opening in openings for end in (opening.a, opening.b)]
    items = {item.name: item for item in [*scene.items, *ends]}
    given = [case for case in PARAMETERS if case[0] is make and not case[2].startswith("film.")]
    for _, _, parameter, _, value in given:
        name, _, what = parameter.rpartition(".")
        assert what in adjoint.names_of(items[name])
        assert adjoint.value(items[name], what) == pytest.approx(value, rel=1e-15)


@cache
def linearised(make, chamber: str) -> gx.analysis.Gradient:
    """The pressure in a chamber at the end, with its derivatives by all parameters of the scene."""
    run, tape = recorded(make, MPI.COMM_WORLD)
    names = [case[2] for case in PARAMETERS if case[0] is make]
    return gx.analysis.gradient(tape, of=pressure_of(run, chamber), by=names)


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    ("make", "chamber", "name", "argument", "value"),
    PARAMETERS,
    ids=[case[2] for case in PARAMETERS],
)
def test_remainders_are_of_second_order(comm, make, chamber, name, argument, value):
    """p(x + δ) - p(x) - δ dp/dx falls with δ², of the pressure at the end."""
    found = linearised(make, chamber)
    (slope,) = found[name].values if found[name].function is None else [None]

    def remainder(δ: float) -> float:
        changed, _ = recorded(make, comm, **{argument: value + δ})
        return changed.chamber(chamber).pressure - found.value - δ * slope

    # Small changes, so that the same steps see the same regime of flow.
    sizes = [value * part for part in (1e-3, 2.5e-4)]
    if name == "wall.temperature":
        # The pressure is nearly linear in it: remainders of smaller changes are its round-off.
        sizes = [10 * size for size in sizes]
    remainders = [remainder(δ) for δ in sizes]
    # The function is smooth: the order is 2 to within the third-order term.
    assert 1.9 < observed_order(sizes, remainders) < 2.1, (slope, remainders)


def test_the_time_at_which_a_pressure_is_reached_has_a_derivative(comm):
    """By the area of the inlet, against differences; the same steps, so that the time is a smooth
    function."""
    run, tape = recorded(airbag_from_a_tank, comm)
    reached = gx.analysis.CrossingTime(pressure_of(run, "bag"), 1200.0)
    found = gx.analysis.gradient(tape, of=reached, by=["inlet.area", "film.thickness"])
    assert 0 < found.value < run.system.unknowns.time
    # 1e-4 of the area: truncation 1e-8, round-off far below.
    δ = 1e-4 * 5e-5
    times = []
    for area in (5e-5 - δ, 5e-5 + δ):
        run, tape = recorded(airbag_from_a_tank, comm, area=area)
        other = gx.analysis.CrossingTime(pressure_of(run, "bag"), 1200.0)
        times.append(gx.analysis.gradient(tape, of=other, by=["inlet.area"]).value)
    difference = (times[1] - times[0]) / (2 * δ)
    assert found["inlet.area"].values[0] == pytest.approx(difference, rel=1e-7)
    assert difference < 0  # a wider inlet fills the bag earlier


def test_a_value_that_is_not_reached_is_refused(comm):
    run, tape = recorded(airbag_from_a_tank, comm)
    never = gx.analysis.CrossingTime(pressure_of(run, "bag"), 1e6)
    with pytest.raises(gx.InputError, match="does not pass 1000000"):
        gx.analysis.gradient(tape, of=never, by=["inlet.area"])
    with pytest.raises(gx.InputError, match="one state does not know"):
        never(run)


def test_what_the_gas_has_not_is_named_with_what_it_has(comm):
    _, tape = recorded(airbag_from_a_tank, comm)
    with pytest.raises(
        gx.InputError, match=r"'inlet' has no parameter 'diameter'.*area, discharge"
    ):
        gx.analysis.gradient(tape, of=gx.analysis.Energy(), by=["inlet.diameter"])


def test_orifice_and_tank_are_found_again_from_what_they_did(comm):
    # Values that the search must recover; opening_time starts from others.
    """Newton's method with the derivatives of runs, from 25 % and 15 % off."""
    area = 8e-8
    pressure = 3.5e6
    until = 2e-3
    shown = opening_time.opening(comm, area, pressure, until, cells=2)
    found = opening_time.main(
        wanted_time=shown.time,
        wanted_pressure=shown.pressure,
        until=until,
        cells=2,
        runs=5,
        comm=comm,
    )
    # Five Newton steps from 25 % off: quadratic convergence would give more digits.
    assert found["orifice_mm2"] == pytest.approx(1e6 * area, rel=1e-3)
    assert found["tank_kPa"] == pytest.approx(pressure / 1e3, rel=1e-3)
