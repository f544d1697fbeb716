"""Gas at rest is a function of its volume, whatever the way to an equilibrium."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import gossamer_fx as gx
from gossamer_fx.meshes.airbag import airbag
from tests.small_scenes import at_rest

AIR = gx.IdealGas(gamma=1.4, R=287.05)
AREA = 0.01
V0 = 2e-3
P0 = 8e4


def piston_on_a_spring(comm, stiffness: float, number: int = 0) -> list[object]:
    """A mass that closes a chamber and is held by springs; it can move along x."""
    mass = gx.PointMass(0.5, name=f"piston {number}", comm=comm)
    chamber = gx.Chamber(
        gx.gas.Piston(mass.port(), AREA, direction=(1.0, 0.0, 0.0)),
        gas=AIR,
        pressure=P0,
        temperature=300.0,
        dead_volume=V0,
        name=f"chamber {number}",
    )
    springs = [
        gx.connectors.AxialSpring(mass.port(), k, direction=tuple(axis), name=f"{name} {number}")
        for k, axis, name in zip((stiffness, 1e3, 1e3), np.eye(3), "xyz", strict=True)
    ]
    return [mass, chamber, *springs]


def exact_position(stiffness: float, exponent: float) -> float:
    """x of p0 (V0/(V0 + A x))^n A = k x."""
    return brentq(lambda x: P0 * (V0 / (V0 + AREA * x)) ** exponent * AREA - stiffness * x, 0, 50)


@pytest.mark.parametrize(("process", "exponent"), [("adiabatic", 1.4), ("isothermal", 1.0)])
@pytest.mark.parametrize("first_step", [2e-4, 2e-2, 2.0])
def test_a_piston_on_a_spring_keeps_its_law(comm, process, exponent, first_step):
    """p V^n = const to round-off for expansions to 3.4 times the volume, for every pseudo-step."""
    for stiffness in (1e5, 1e3, 300.0):
        mass, *others = piston_on_a_spring(comm, stiffness)
        search = gx.analysis.Continuation(tolerance=1e-11, first_step=first_step)
        equilibrium = gx.Equilibrium(gx.Scene(mass, *others), search, gas=process)
        equilibrium.find()
        gas = equilibrium.chamber("chamber 0")
        assert gas.pressure * gas.volume**exponent == pytest.approx(P0 * V0**exponent, rel=1e-13)
        assert gas.internal_energy == pytest.approx(gas.pressure * gas.volume / 0.4, rel=1e-13)
        position = gx.probes.Position(mass.port(), "x")(equilibrium)
        assert position == pytest.approx(exact_position(stiffness, exponent), rel=1e-8)
        # The gas stiffens the spring by n p A²/V.
        of_gas = exponent * gas.pressure * AREA**2 / gas.volume
        both = gx.analysis.point_stiffness(equilibrium, mass.port(), direction=(1.0, 0.0, 0.0))
        assert both == pytest.approx(stiffness + of_gas, rel=1e-9)


def test_two_chambers_and_a_way_with_a_detour(comm):
    """Loads that come and go do not change the gas, nor does the other chamber."""
    first = piston_on_a_spring(comm, 1e3, 0)
    second = piston_on_a_spring(comm, 300.0, 1)
    push = gx.loads.Force(first[0].port(), lambda t: (-500.0 * np.sin(np.pi * t), 0.0, 0.0))
    search = gx.analysis.Continuation(tolerance=1e-12)
    equilibrium = gx.Equilibrium(gx.Scene(*first, *second, push), search)
    invariant = P0 * V0**1.4
    for at in (0.0, 0.5, 1.5, 0.25, 1.0):
        equilibrium.find(at)
        for number in (0, 1):
            gas = equilibrium.chamber(f"chamber {number}")
            assert gas.pressure * gas.volume**1.4 == pytest.approx(invariant, rel=1e-12)
    for items, stiffness in ((first, 1e3), (second, 300.0)):
        position = gx.probes.Position(items[0].port(), "x")(equilibrium)
        assert position == pytest.approx(exact_position(stiffness, 1.4), rel=1e-8)


def test_nothing_flows_between_pressures_that_are_held(comm):
    """A bottle is open to the piston: both pressures are constant, and k x = p A."""
    mass, chamber, *springs = piston_on_a_spring(comm, 1e3)
    bottle = gx.Tank(1e-3, gas=AIR, pressure=2e5, temperature=300.0, name="bottle")
    scene = gx.Scene(mass, chamber, *springs, gx.Orifice(bottle, chamber, area=1e-6))
    equilibrium = gx.Equilibrium(scene, gas="held pressure")
    equilibrium.find()
    assert equilibrium.chamber("bottle").pressure == pytest.approx(2e5, rel=1e-12)
    assert equilibrium.chamber("chamber 0").pressure == pytest.approx(P0, rel=1e-12)
    assert gx.probes.Position(mass.port(), "x")(equilibrium) == pytest.approx(P0 * AREA / 1e3)


def drum(comm, thickness: float) -> tuple[gx.Equilibrium, gx.Chamber]:
    """A film over a closed box of gas, which bulges into thinner air, at its equilibrium."""
    film = gx.Membrane(
        airbag(comm, 1.0, 6),
        gx.Linear(E=1e7, nu=0.3, density=1000.0, thickness=thickness),
        initial_stress=1e4,
        name="film",
    )
    chamber = gx.Chamber(
        film,
        gas=AIR,
        pressure=2e3,
        temperature=300.0,
        dead_volume=0.2,
        outside=gx.gas.Ambient(1e3, 300.0),
    )
    held = [gx.Fixed(film, "seam"), gx.Fixed(film, "bottom")]
    search = gx.analysis.Continuation(tolerance=1e-10)
    equilibrium = at_rest(chamber, *held, search=search)
    return equilibrium, chamber


@pytest.mark.mpi
def test_the_gradient_at_an_equilibrium_of_gas_is_that_of_differences(comm):
    """dp/dt and dE/dt by the thickness of a film over closed gas, against central differences."""
    equilibrium, chamber = drum(comm, 1e-3)
    results = ((gx.analysis.ChamberPressure(chamber), "pressure"), (gx.analysis.Energy(), None))
    change = 1e-5

    def value(thickness: float, attribute: str | None) -> float:
        found, _ = drum(comm, thickness)
        if attribute is None:
            return sum(found.totals.stored.values())
        return getattr(found.chamber("chamber"), attribute)

    for objective, attribute in results:
        gradient = gx.analysis.gradient(equilibrium, of=objective, by=["film.thickness"])
        difference = value(1e-3 + change, attribute) - value(1e-3 - change, attribute)
        [derivative] = gradient["film.thickness"].values
        assert derivative == pytest.approx(difference / (2 * change), rel=1e-4)


def test_gradients_of_gas_that_flows_are_refused(comm):
    first = piston_on_a_spring(comm, 1e3, 0)
    tank = gx.Tank(volume=1e-3, gas=AIR, pressure=P0, temperature=300.0)
    orifice = gx.Orifice(tank, first[1], area=1e-6)
    equilibrium = at_rest(*first, orifice)
    position = gx.probes.Position(first[0].port(), "x")
    with pytest.raises(gx.InputError, match="leave the openings out"):
        gx.analysis.gradient(equilibrium, of=position, by=["x 0.stiffness"])


def test_the_shape_of_a_film_with_gas_is_refused(comm):
    equilibrium, chamber = drum(comm, 1e-3)
    with pytest.raises(gx.InputError, match="depends on the shape"):
        gx.analysis.gradient(
            equilibrium, of=gx.analysis.ChamberPressure(chamber), by=["film.shape"]
        )
