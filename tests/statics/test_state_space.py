"""Structures as linear systems: closed forms, responses at frequencies, and the exported unit."""

from __future__ import annotations

import ctypes
import math
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.analysis import harmonic_response, modes, state_space
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import at_rest

MASS = 2.0  # kg
STIFFNESS = 800.0  # N/m


def oscillator(comm):
    point = gx.PointMass(MASS, (0.0, 0.0, -1.0), comm=comm)
    axes = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    springs = [
        gx.connectors.AxialSpring(
            point.port(), k * STIFFNESS, direction=axis, origin=(0.0, 0.0, -1.0), name=f"to {axis}"
        )
        for k, axis in enumerate(axes, start=1)
    ]
    return point, at_rest(*springs)


def system_of(comm, **damped):
    """The oscillator with a force and a moving ground as inputs, its height and speed as
    outputs."""
    point, equilibrium = oscillator(comm)
    return state_space(
        equilibrium,
        modes(equilibrium, 3),
        of={
            "z [m]": gx.probes.Position(point.port(), "z"),
            "speed [m/s]": gx.probes.Velocity(point.port(), "z"),
        },
        loads={"force [N]": [gx.loads.Force(point.port(), (0.0, 0.0, 1.0))]},
        base_acceleration={"ground [m/s²]": (0.0, 0.0, 1.0)},
        **damped,
    )


@pytest.mark.mpi
def test_an_oscillator_answers_a_held_force_as_its_closed_form(comm):
    """x = F/k (1 - e^(-ζωt) (cos ω_d t + ζω/ω_d sin ω_d t)), in steps of any length."""
    ζ = 0.05
    system = system_of(comm, damping_ratio=ζ)
    ω = math.sqrt(STIFFNESS / MASS)
    ω_d = ω * math.sqrt(1 - ζ**2)
    for dt in (0.003, 0.2):
        u = np.tile([3.0, 0.0], (20, 1))
        y = system.simulate(u, dt=dt)
        t = dt * np.arange(20)
        decay = np.exp(-ζ * ω * t)
        x = 3.0 / STIFFNESS * (1 - decay * (np.cos(ω_d * t) + ζ * ω / ω_d * np.sin(ω_d * t)))
        assert np.allclose(y[:, 0], -1.0 + x, atol=1e-12)
    # A ground that is accelerated is a force -m a.
    ground = system.simulate(np.tile([0.0, 1.0], (5, 1)), dt=0.1)
    force = system.simulate(np.tile([-MASS, 0.0], (5, 1)), dt=0.1)
    assert np.allclose(ground, force, atol=1e-13)


@pytest.mark.mpi
def test_a_membrane_has_the_transfer_function_of_its_harmonic_response(comm):
    """With few modes, too: what is beyond them answers statically in both, but for its small
    inertia."""
    law = gx.Linear(E=1e8, nu=0.3, density=1000.0, thickness=1e-4)
    film = gx.Membrane(sheet(comm, 6, 6, crossed=True), law, initial_strain=1e-3, name="film")
    rim = [gx.Fixed(film, side) for side in ("left", "right", "top", "bottom")]
    equilibrium = at_rest(film, *rim)
    found = modes(equilibrium, 12)
    middle = gx.probes.Position(film.port_at((0.5, 0.5, 0.0)), "z")
    push = [gx.Pressure(film, 2.0)]
    system = state_space(
        equilibrium, found, of={"z": middle}, loads={"p": push}, damping_ratio=0.02
    )
    f = np.array([0.0, 0.3, 0.9, 1.1]) * found[0].frequency
    expected = harmonic_response(
        equilibrium, found, of={"z": middle}, frequencies=f, loads=push, damping_ratio=0.02
    ).values["z"]
    for frequency, value in zip(f, expected, strict=True):
        s = 2j * math.pi * frequency
        H = system.C @ np.linalg.solve(s * np.eye(len(system.A)) - system.A, system.B) + system.D
        assert abs(H[0, 0] - value) < 1e-3 * abs(value)
    # At rest exactly.
    static = system.D - system.C @ np.linalg.solve(system.A, system.B)
    assert static[0, 0] == pytest.approx(expected[0].real, rel=1e-9)


def test_arrays_are_saved(comm, tmp_path: Path):
    system = system_of(comm)
    system.save(tmp_path / "system.npz")
    with np.load(tmp_path / "system.npz") as saved:
        assert np.array_equal(saved["A"], system.A) and np.array_equal(saved["D"], system.D)
        assert saved["inputs"].tolist() == ["force [N]", "ground [m/s²]"]


def test_a_unit_makes_the_steps_of_the_system(comm, tmp_path: Path):
    """By its C functions, as a master calls them."""
    system = system_of(comm, damping_ratio=0.01)
    path = tmp_path / "oscillator.fmu"
    system.write_fmu(path)
    with zipfile.ZipFile(path) as unit:
        description = ET.fromstring(unit.read("modelDescription.xml"))
        identifier = description.find("CoSimulation").get("modelIdentifier")
        unit.extract(f"binaries/linux64/{identifier}.so", tmp_path)
    variables = {
        one.get("name"): int(one.get("valueReference"))
        for one in description.iter("ScalarVariable")
    }
    assert list(variables) == ["force [N]", "ground [m/s²]", "z [m]", "speed [m/s]"]
    c = ctypes.CDLL(str(tmp_path / f"binaries/linux64/{identifier}.so"))
    c.fmi2Instantiate.restype = ctypes.c_void_p
    guid = description.get("guid").encode()
    assert not c.fmi2Instantiate(b"unit", 1, b"another", None, None, 0, 0)
    instance = ctypes.c_void_p(c.fmi2Instantiate(b"unit", 1, guid, None, None, 0, 0))
    assert instance
    number = ctypes.c_double

    def value(name: str) -> float:
        found = number()
        reference = ctypes.c_uint(variables[name])
        assert c.fmi2GetReal(instance, ctypes.byref(reference), 1, ctypes.byref(found)) == 0
        return found.value

    u = np.random.default_rng(2).normal(size=(30, 2))
    dt = 0.05
    expected = system.simulate(u, dt=dt)
    states = system.simulate(np.zeros((1, 2)), dt=dt)
    assert value("z [m]") == pytest.approx(states[0, 0], rel=1e-14)
    for k, inputs in enumerate(u):
        for name, given in zip(system.inputs, inputs, strict=True):
            reference = ctypes.c_uint(variables[name])
            held = number(given)
            assert c.fmi2SetReal(instance, ctypes.byref(reference), 1, ctypes.byref(held)) == 0
        assert value("z [m]") == pytest.approx(expected[k, 0], abs=1e-11)
        assert value("speed [m/s]") == pytest.approx(expected[k, 1], abs=1e-11)
        assert c.fmi2DoStep(instance, number(k * dt), number(dt), 0) == 0
    # An output is not set.
    reference = ctypes.c_uint(variables["z [m]"])
    assert c.fmi2SetReal(instance, ctypes.byref(reference), 1, ctypes.byref(number(1.0))) != 0
    c.fmi2FreeInstance(instance)


def test_a_unit_is_valid_for_fmpy(comm, tmp_path: Path):
    fmpy = pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    system = system_of(comm, damping_ratio=0.01)
    path = tmp_path / "oscillator.fmu"
    system.write_fmu(path)
    assert not validate_fmu(str(path))
    found = fmpy.simulate_fmu(
        str(path), stop_time=1.0, output_interval=0.05, start_values={"force [N]": 3.0}
    )
    expected = system.simulate(np.tile([3.0, 0.0], (21, 1)), dt=0.05)
    assert np.allclose(found["z [m]"], expected[:, 0], atol=1e-10)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"loads": {}}, r"loads is \{\} and base_acceleration is \{\}"),
        ({"of": {"force [N]": None}}, "derivatives|name of two"),
    ],
)
def test_what_is_wrong_is_said(comm, changed, words):
    point, equilibrium = oscillator(comm)
    given = {
        "of": {"z": gx.probes.Position(point.port(), "z")},
        "loads": {"force [N]": [gx.loads.Force(point.port(), (0.0, 0.0, 1.0))]},
    } | changed
    with pytest.raises(gx.InputError, match=words):
        state_space(equilibrium, modes(equilibrium, 3), **given)


def test_a_unit_has_its_suffix(comm, tmp_path: Path):
    with pytest.raises(gx.InputError, match=r"give a name that ends in \.fmu"):
        system_of(comm).write_fmu(tmp_path / "unit.zip")
