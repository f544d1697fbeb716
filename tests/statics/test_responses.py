"""Harmonic and random responses by modes against closed forms and integration in time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import jv

import gossamer_fx as gx
from demos.studies import vibration
from demos.studies.vibration import N0, TENSIONED, THICKNESS
from gossamer_fx.analysis import harmonic_response, modes, random_response
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import LINEAR, at_rest

MASS = 2.0  # kg
STIFFNESS = 800.0  # N/m
OWN = math.sqrt(STIFFNESS / MASS) / (2 * math.pi)  # Hz


def oscillator(comm, damping=0.0):
    """A mass on springs along three axes, of which that along z is the softest, and a damper."""
    point = gx.PointMass(MASS, (0.0, 0.0, -1.0), comm=comm)
    springs = [
        gx.connectors.AxialSpring(
            point.port(), k * STIFFNESS, direction=axis, origin=(0.0, 0.0, -1.0), name=f"to {axis}"
        )
        for k, axis in ((1, (0.0, 0.0, 1.0)), (2, (1.0, 0.0, 0.0)), (3, (0.0, 1.0, 0.0)))
    ]
    items = [*springs]
    if damping:
        top = gx.Ground((0.0, 0.0, 0.0))
        items.append(gx.connectors.Damper(point.port(), top, damping=damping))
    return point, at_rest(*items)


@pytest.mark.mpi
def test_an_oscillator_with_all_kinds_of_damping(comm):
    """x = F/(k (1 + iη) - m ω² + iω (c + 2 ζ m ω0)), exactly."""
    c = 1.3
    η = 0.02
    ζ = 0.01
    point, equilibrium = oscillator(comm, damping=c)
    height = gx.probes.Position(point.port(), "z")
    speed = gx.probes.Velocity(point.port(), "z")
    softest = next(one for one in equilibrium.scene.items if one.name == f"to {(0.0, 0.0, 1.0)}")
    f = np.array([0.0, 1.0, OWN, 5.0])
    found = harmonic_response(
        equilibrium,
        modes(equilibrium, 3),
        of={
            "z [m]": height,
            "speed [m/s]": speed,
            "to the ground [N]": gx.probes.Reaction(softest, "z"),
        },
        frequencies=f,
        loads=[gx.loads.Force(point.port(), (0.0, 0.0, 3.0))],
        loss_factor=η,
        damping_ratio=ζ,
    )
    ω = 2 * np.pi * f
    ω0 = 2 * np.pi * OWN
    exact = 3.0 / (STIFFNESS * (1 + 1j * η) - MASS * ω**2 + 1j * ω * (c + 2 * ζ * MASS * ω0))
    np.testing.assert_allclose(found.values["z [m]"], exact, rtol=1e-10)
    np.testing.assert_allclose(found.values["speed [m/s]"], 1j * ω * exact, rtol=1e-10, atol=1e-20)
    np.testing.assert_allclose(found.acceleration("z [m]"), -(ω**2) * exact, rtol=1e-10, atol=1e-20)
    # What the ground exerts through the spring, with its share of the loss.
    force = -STIFFNESS * (1 + 1j * η) * exact
    np.testing.assert_allclose(found.values["to the ground [N]"], force, rtol=1e-10)
    assert found.peak("z [m]") == (f[2], pytest.approx(abs(exact[2])))
    assert found.phase("z [m]")[2] == pytest.approx(np.angle(exact[2]), rel=1e-8)
    # The shape of the vibration, as one mode.
    z = found.at(5.0).displacements[point.name][:, 2]
    assert np.array(comm.allreduce(z.sum())) == pytest.approx(exact[3], rel=1e-10)


@pytest.mark.mpi
def test_miles_equation(comm):
    """White noise of the ground: σ of the absolute acceleration is √(π/2 f0 Q G (1 + 4 ζ²)), that
    of the deflection √(π/2 f0 Q G)/ω0², with Q = 1/(2 ζ), and f0 are its crossings."""
    ζ = 0.01
    G = 1e-2
    point, equilibrium = oscillator(comm)
    options = {
        "of": {"z [m]": gx.probes.Position(point.port(), "z")},
        "base_acceleration": (0.0, 0.0, 1.0),
        "damping_ratio": ζ,
    }
    found = random_response(
        equilibrium, modes(equilibrium, 3), density=G, band=(1e-4, 1e6), **options
    )
    miles = math.sqrt(math.pi / 2 * OWN / (2 * ζ) * G)
    assert found.rms["z [m]"] == pytest.approx(miles / (2 * math.pi * OWN) ** 2, rel=1e-6)
    assert found.crossings["z [m]"] == pytest.approx(OWN, rel=1e-6)
    # The transmitted acceleration falls with 1/f only, so that the band ends too early by a little.
    exact = miles * math.sqrt(1 + 4 * ζ**2)
    assert found.acceleration_rms["z [m]"] == pytest.approx(exact, rel=1e-6)
    assert found.largest("z [m]", 100.0) / found.rms["z [m]"] == pytest.approx(
        math.sqrt(2 * math.log(100 * OWN)), rel=1e-6
    )
    # Corners of a table and a function: 1e-3 to 4 Hz with a rise of 6 dB an octave.
    slope = [(1.0, 1e-3), (4.0, 16e-3)]
    by_table = random_response(equilibrium, modes(equilibrium, 3), density=slope, **options)
    by_function = random_response(
        equilibrium, modes(equilibrium, 3), density=lambda f: 1e-3 * f**2, band=(1, 4), **options
    )
    f = np.linspace(1.0, 4.0, 200001)
    H = 1 / ((2 * np.pi) ** 2 * (OWN**2 - f**2 + 2j * ζ * OWN * f))
    expected = math.sqrt(np.trapezoid(np.abs(H) ** 2 * 1e-3 * f**2, f))
    assert by_table.rms["z [m]"] == pytest.approx(expected, rel=1e-6)
    assert by_function.rms["z [m]"] == pytest.approx(expected, rel=1e-6)


@pytest.mark.mpi
@pytest.mark.parametrize("count", [1, 6])
def test_a_drum_under_harmonic_pressure(comm, count):
    """w = p/(N κ²) (J0(κ r)/J0(κ a) - 1), κ² = ω² ρt/N with N (1 + iη), in the middle; with one
    mode, too, to which the static correction adds the others."""
    equilibrium = vibration_at_rest(comm)
    [film] = equilibrium.system.unknowns.bodies
    η = 0.05
    p = 1e-3
    first = vibration.EXACT["circle"][0]
    f = np.array([0.0, 0.5, 1.0, 1.2]) * first
    found = harmonic_response(
        equilibrium,
        modes(equilibrium, count),
        of={"w [m]": gx.probes.Position(film.port_at((0.0, 0.0, 0.0)), "z")},
        frequencies=f,
        loads=[gx.Pressure(film, p)],
        loss_factor=η,
    )
    N = N0 * (1 + 1j * η)
    κ = 2 * np.pi * f[1:] * np.sqrt(TENSIONED.density * THICKNESS / N)
    exact = [p / (4 * N), *p / (N * κ**2) * (1 / jv(0, κ) - 1)]
    # The static correction is exact to the second order of f/f_k of the other modes.
    errors = np.abs(found.values["w [m]"] / exact - 1)
    assert (errors < ([2e-3, 0.01, 0.01, 0.08] if count == 1 else 2e-3)).all()
    # The sign: a pressure pushes along the normal, here to one side at rest.
    assert abs(found.phase("w [m]")[0]) < 0.1


def vibration_at_rest(comm):
    equilibrium = gx.Equilibrium(vibration.film_of(comm, "circle", 2, 8))
    equilibrium.find()
    return equilibrium


def tensioned_cable(comm, motion=None, **options):
    """A string of 1 m with a tension of 10 N and 0.1 kg/m: its first frequency is 5 Hz."""
    cable = gx.Cable(
        line(comm, [(0, 0, 0), (1, 0, 0)], 16),
        gx.CableLaw(1e4, 0.1),
        initial_tension=10.0,
        **options,
    )
    ends = [gx.Fixed(cable, end, motion=motion, name=end) for end in ("start", "end")]
    return cable, ends


@pytest.mark.mpi
def test_a_string_whose_ends_move(comm):
    """Seen from the ends, w = a/ω² (1 - cos(κ (x - L/2))/cos(κ L/2)), κ = ω √(μ/T)."""
    cable, ends = tensioned_cable(comm)
    equilibrium = at_rest(*ends)
    f = np.array([2.0, 4.0, 7.0])
    found = harmonic_response(
        equilibrium,
        modes(equilibrium, 10),
        of={
            "w [m]": gx.probes.Position(cable.port_at((0.5, 0.0, 0.0)), "z"),
            "force [N]": gx.probes.Reaction(ends[0], "z"),
        },
        frequencies=f,
        base_acceleration=(0.0, 0.0, 2.0),
    )
    ω = 2 * np.pi * f
    exact = 2.0 / ω**2 * (1 - 1 / np.cos(ω * np.sqrt(0.1 / 10.0) / 2))
    np.testing.assert_allclose(found.values["w [m]"], exact, rtol=1e-2)
    # T w' at one end, T = 10 N: half of what all of its mass needs.
    κ = ω * np.sqrt(0.1 / 10.0)
    force = 10.0 * 2.0 / ω**2 * κ * np.tan(κ / 2)
    np.testing.assert_allclose(found.values["force [N]"], force, rtol=0.015)
    with_ground = -(ω**2) * found.values["w [m]"] + 2.0
    np.testing.assert_allclose(found.acceleration("w [m]"), with_ground)


def string_with_absorber(comm, **options):
    """The string with a mass hung on it by a spring and a damper, which couples its modes."""
    cable, ends = tensioned_cable(comm, **options)
    where = cable.port_at((0.25, 0.0, 0.0))
    velocity = (0.0, 0.0, 0.0)
    if "velocity" in options:
        velocity = tuple(options["velocity"](np.zeros((3, 1)))[:, 0])
    mass = gx.PointMass(0.02, (0.25, 0.0, -0.2), velocity=velocity, comm=comm, name="absorber")
    items = [
        *ends,
        gx.connectors.Spring(mass.port(), where, stiffness=40.0, length=0.2),
        gx.connectors.Damper(mass.port(), where, damping=1.0),
    ]
    for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):
        guide = gx.connectors.AxialSpring(
            mass.port(), 100.0, direction=axis, origin=(0.25, 0.0, 0.0), name=f"guide {axis}"
        )
        items.append(guide)
    return cable, where, items


@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["force", "ground"])
def test_against_integration_in_time(comm, kind):
    """Amplitude and phase of the steady vibration of a string, by the program's own steps."""
    f = 6.0
    ω = 2 * math.pi * f
    amplitude = 1e-5  # m of the ground

    def motion(X, t):
        return np.vstack([0 * X[:2], 0 * X[0] + amplitude * math.sin(ω * t)])

    def velocity(X):
        """That of the ends, with which the whole string begins."""
        return np.vstack([0 * X[:2], 0 * X[0] + amplitude * ω])

    moving = {"motion": motion, "velocity": velocity} if kind == "ground" else {}
    cable, where, items = string_with_absorber(comm, **moving)
    if kind == "force":
        force = lambda t: (0.0, 0.0, 1e-3 * math.sin(ω * t))  # noqa: E731
        items.append(gx.loads.Force(where, force))
    curve = gx.Series({"z": gx.probes.Position(cable.port_at((0.625, 0.0, 0.0)), "z")})
    run = gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=1 / (f * 60)), outputs=[curve])
    run.run(until=60 / f)
    # The last two periods, as Im(v e^(iωt)).
    last = slice(-121, -1)
    measured = 2j * np.mean(curve["z"][last] * np.exp(-1j * ω * curve.time[last]))

    cable, where, items = string_with_absorber(comm)
    excitation = {"base_acceleration": (0.0, 0.0, -amplitude * ω**2)}
    if kind == "force":
        excitation = {"loads": [gx.loads.Force(where, (0.0, 0.0, 1e-3))]}
    equilibrium = at_rest(*items)
    found = harmonic_response(
        equilibrium,
        modes(equilibrium, 12),
        of={"z": gx.probes.Position(cable.port_at((0.625, 0.0, 0.0)), "z")},
        frequencies=[f],
        **excitation,
    )
    [value] = found.values["z"]
    if kind == "ground":
        value += amplitude
    # The midpoint rule is late by (ω dt)²/12 = 1e-3 of each frequency, which resonance enlarges.
    assert abs(measured - value) < 6e-3 * abs(value)


def test_the_gas_of_a_drum_swings_along(comm):
    """A piston on closed gas: p = -γ p A x/V, x = F/(γ p A²/V - m ω²)."""
    mass, area, volume, pressure = 2.0, 0.01, 2e-3, 1e5
    piston = gx.PointMass(mass, (0.0, 0.0, 0.0), comm=comm)
    gas = gx.Chamber(
        gx.gas.Piston(piston.port(), area, direction=(0.0, 0.0, 1.0)),
        gas=gx.IdealGas(1.4, 287.0),
        pressure=pressure,
        temperature=300.0,
        dead_volume=volume,
        outside=gx.gas.Ambient(pressure),
    )
    across = [
        gx.connectors.AxialSpring(piston.port(), 50.0, direction=axis, name=f"spring {axis}")
        for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    ]
    equilibrium = at_rest(piston, gas, *across)
    f = np.array([0.0, 30.0])
    found = harmonic_response(
        equilibrium,
        modes(equilibrium, 3),
        of={
            "z [m]": gx.probes.Position(piston.port(), "z"),
            "p [Pa]": gx.analysis.ChamberPressure(gas),
        },
        frequencies=f,
        loads=[gx.loads.Force(piston.port(), (0.0, 0.0, 5.0))],
    )
    k = 1.4 * pressure * area**2 / volume
    exact = 5.0 / (k - mass * (2 * np.pi * f) ** 2)
    np.testing.assert_allclose(found.values["z [m]"], exact, rtol=1e-9)
    np.testing.assert_allclose(
        found.values["p [Pa]"], -1.4 * pressure * area / volume * exact, rtol=1e-9
    )


def test_a_drum_over_closed_air(comm):
    """Far below its modes the response is the difference of two equilibria, with one mode and the
    stiffness of adiabatic gas in the static correction."""

    def drum(more):
        film = gx.Membrane(airbag(comm, 1.0, 6), TENSIONED, initial_stress=N0 / THICKNESS)
        items = [film, gx.Fixed(film, "seam"), gx.Fixed(film, "bottom")]
        items.append(
            gx.Chamber(
                film, gas=gx.IdealGas(1.4, 287.0), pressure=1e3, temperature=300.0, dead_volume=0.1
            )
        )
        items += [gx.Pressure(film, 1e3 - more, group="top", name="outside")] if more else []
        return film, items

    film, items = drum(0.0)
    weight = gx.Gravity(film, (0.0, 0.0, -0.1))
    items.append(gx.Pressure(film, -1e3, name="outside"))
    probe = gx.analysis.EnclosedVolume(film)
    equilibrium = at_rest(*items)
    found = harmonic_response(
        equilibrium,
        modes(equilibrium, 1),
        of={"V [m³]": probe},
        frequencies=[0.0],
        loads=[weight],
    )
    before = probe(equilibrium)
    loaded = at_rest(*items, weight)
    change = probe(loaded) - before
    assert found.values["V [m³]"][0].real == pytest.approx(change, rel=1e-3)


@pytest.mark.mpi
def test_what_floats_is_pushed_by_all_of_its_mass(comm):
    """A force along x on a free beam: -F/(m ω²) in the middle with its six rigid motions, and an
    elastic share by the static correction; without the rigid motions it is refused."""
    section = gx.sections.tube(0.03, 1e-3, E=100e9, nu=0.3, density=1600.0)
    beam = gx.Beam(line(comm, [(0, 0, 0), (2, 0, 0)], 8), section)
    equilibrium = at_rest(beam)
    options = {
        "of": {"x [m]": gx.probes.Position(beam.port("end"), "x")},
        "loads": [gx.loads.Force(beam.port("end"), (5.0, 0.0, 0.0))],
        "frequencies": [30.0],
    }
    found = harmonic_response(equilibrium, modes(equilibrium, 6), **options)
    # A rod that is pushed at its end: u = -F/(EA κ) / tan(κ L), κ = ω √(μ/EA).
    κ = 2 * np.pi * 30.0 * math.sqrt(section.line_density / section.EA)
    exact = -5.0 / (section.EA * κ * math.tan(2 * κ))
    assert found.values["x [m]"][0].real == pytest.approx(exact, rel=1e-4)
    with pytest.raises(gx.InputError, match="not among the modes; hold it, or ask"):
        harmonic_response(equilibrium, modes(equilibrium, 6)[1:], **options)
    with pytest.raises(gx.InputError, match="at 0 Hz what moves freely"):
        harmonic_response(equilibrium, modes(equilibrium, 6), **options | {"frequencies": [0.0]})


def test_a_band_shows_resonances_and_a_picture(comm, folder):
    point, equilibrium = oscillator(comm)
    options = {
        "of": {"z [m]": gx.probes.Position(point.port(), "z")},
        "loads": [gx.loads.Force(point.port(), (0.0, 0.0, 1.0))],
        "loss_factor": 1e-4,
    }
    found = harmonic_response(equilibrium, modes(equilibrium, 3), band=(0.1, 6.0), **options)
    frequency, amplitude = found.peak("z [m]")
    assert frequency == pytest.approx(OWN, rel=1e-5)
    assert amplitude == pytest.approx(1 / (STIFFNESS * 1e-4), rel=0.05)
    found.plot(folder / "response.png")
    noise = random_response(
        equilibrium, modes(equilibrium, 3), density=1.0, band=(0.1, 6.0), **options
    )
    noise.plot(folder / "noise.png")
    assert (folder / "response.png").is_file() and (folder / "noise.png").is_file()
    folders = gx.outputs.record_modes(equilibrium, [found.at(OWN)], folder / "shape", frames=4)
    assert gx.plot.RunReader(folders[0]).kind == "mode"


def test_few_modes_are_warned_of(comm, caplog):
    cable, ends = tensioned_cable(comm)
    equilibrium = at_rest(*ends)
    options = {
        "of": {"z [m]": gx.probes.Position(cable.port_at((0.5, 0.0, 0.0)), "z")},
        "base_acceleration": (0.0, 0.0, 1.0),
        "frequencies": [20.0],
    }
    harmonic_response(equilibrium, modes(equilibrium, 14), **options)
    assert "resonances above" not in caplog.text
    harmonic_response(equilibrium, modes(equilibrium, 2), **options)
    assert "the modes reach 5" in caplog.text


def test_what_is_not_supported_is_refused_by_name(comm):
    point, equilibrium = oscillator(comm)
    of = {"z [m]": gx.probes.Position(point.port(), "z")}
    push = gx.loads.Force(point.port(), (0.0, 0.0, 1.0), name="push")
    found = modes(equilibrium, 3)

    def asked(equilibrium=equilibrium, shapes=found, **options):
        given = {"of": of, "frequencies": [1.0], "loads": [push]} | options
        return harmonic_response(equilibrium, shapes, **given)

    asked()
    with pytest.raises(gx.InputError, match=r"at 3\.\d+ Hz the response of mode 1 has no bound"):
        asked(frequencies=[found[0].frequency])
    with pytest.raises(gx.InputError, match="mode 1 has no damping"):
        random_response(equilibrium, found, of=of, density=1.0, band=(1, 9), loads=[push])
    with pytest.raises(
        gx.InputError,
        match=r"loads is of the kind list and base_acceleration is \(1\.0, 0\.0, 0\.0\)",
    ):
        asked(base_acceleration=(1.0, 0.0, 0.0))
    with pytest.raises(gx.InputError, match=r"frequencies is \[1\.0\] and band is \(1\.0, 2\.0\)"):
        asked(band=(1.0, 2.0))
    with pytest.raises(gx.InputError, match=r"'spring' \(Spring\) is not a load"):
        top = gx.Ground((0.0, 0.0, 0.0))
        asked(loads=[gx.connectors.Spring(point.port(), top, stiffness=1.0, length=1.0)])
    other = gx.PointMass(1.0, (0.0, 0.0, 0.0), comm=comm, name="other")
    with pytest.raises(gx.InputError, match="other"):
        asked(loads=[gx.Gravity(other)])
    with pytest.raises(gx.InputError, match="'z' is of the kind function; give"):
        asked(of={"z": lambda run: 1.0})
    spin = (0.0, 0.0, 1.0)
    turning = at_rest(*equilibrium.scene.items, gx.loads.Centrifugal(point, spin))
    with pytest.raises(gx.InputError, match="scene turns by 'centrifugal"):
        asked(turning)
    with pytest.raises(gx.InputError, match="modal masses are"):
        asked(shapes=[gx.analysis.Mode(1.0, 0.0, 2 * found[0].shape)])
    film = gx.Membrane(sheet(comm, 2, 2), LINEAR, initial_stress=1e4)
    edges = [gx.Fixed(film, edge) for edge in ("left", "right", "bottom", "top")]
    relaxing = at_rest(*edges, gx.loads.flat_damping(film, loss_factor=0.01, band=(1.0, 10.0)))
    fabric = gx.LinearOrthotropic(
        E1=1e6, E2=1e6, nu12=0.0, G12=5e5, density=1000.0, thickness=1e-3, direction=(1, 0, 0)
    )
    woven = gx.Membrane(sheet(comm, 2, 2), fabric, initial_stress=1e4)
    edges = [gx.Fixed(woven, edge) for edge in ("left", "right", "bottom", "top")]
    yarns = gx.loads.InternalFriction(woven, strain=(0, 0, 1), stiffness=(1e3,), limit=(1.0,))
    rubbing = at_rest(*edges, yarns)
    for refused, body, words in (
        (relaxing, film, "relaxes, so that the stiffness depends"),
        (rubbing, woven, "'internal friction' sticks and slides"),
    ):
        with pytest.raises(gx.InputError, match=words):
            harmonic_response(
                refused,
                modes(refused, 1),
                of={"z": gx.probes.Position(body.port_at((0.5, 0.5, 0.0)), "z")},
                frequencies=[1.0],
                loads=[gx.Pressure(body, 1.0)],
            )


def test_modes_of_what_is_damped_are_those_without(comm):
    """The last pseudo-step of a search has an end, in which a strong damper resists a little."""
    point, equilibrium = oscillator(comm, damping=1e5)
    assert modes(equilibrium, 1)[0].frequency == pytest.approx(OWN, rel=1e-9)
    assert point.name in modes(equilibrium, 1)[0].displacements
