"""Vibrations of tensioned and spinning films about their equilibria."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import brentq

import gossamer_fx as gx
from demos.studies import vibration
from demos.studies.vibration import N0, NU, SPIN, SPUN, STRETCH, TENSIONED, THICKNESS, E
from gossamer_fx import Equilibrium
from gossamer_fx.analysis import modes
from gossamer_fx.mechanics.loads import Centrifugal
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.disc import ring
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import EDGES, sheet
from gossamer_fx.records.fields.film_states import AreaFractions
from tests.small_scenes import at_rest


def rest_of(comm, scene: str, order: int, cells: int) -> Equilibrium:
    """The equilibrium of a scene of the study of vibrations."""
    equilibrium = Equilibrium(vibration.film_of(comm, scene, order, cells))
    equilibrium.find()
    return equilibrium


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    ("order", "cells", "tolerance"),
    [(1, 16, 0.02), (2, 8, 2e-3)],
    ids=["P1", "P2"],
)
def test_square_film_under_tension(comm, order, cells, tolerance):
    """f = ½√(N0/ρt) √((m/a)² + (n/a)²) for a = 2.1 m."""
    equilibrium = rest_of(comm, "square", order, cells)
    found = modes(equilibrium, 4)
    measured = [mode.frequency for mode in found]
    assert measured == pytest.approx(vibration.EXACT["square"], rel=tolerance)
    assert max(mode.growth for mode in found) < 1e-6
    # Modes are the nearest to a frequency, not those above it.
    [nearest] = modes(equilibrium, 1, above=1.01 * measured[0])
    assert nearest.frequency == pytest.approx(measured[0], rel=1e-6)
    assert len(found[0].shape) == equilibrium.system.unknowns.numbering.size_local


@pytest.mark.mpi
def test_modes_near_a_frequency_of_what_floats(comm):
    """A free tube bends in two planes; the next modes, six motions of the whole, are as far from
    the frequency asked for, but for round-off, and may be any two of them."""
    section = gx.sections.tube(0.03, 1e-3, E=100e9, nu=0.3, density=1600.0)
    tube = gx.Beam(line(comm, [(0, 0, 0), (10, 0, 0)], 8), section)
    # (4.730/L)² √(EI/μ), with the length L = 10 m
    bending = 4.730**2 / 100 * np.sqrt(section.EI2 / section.line_density) / (2 * np.pi)
    floating = at_rest(tube)
    found = [mode.frequency for mode in modes(floating, 4, above=0.6 * bending)]
    assert found == pytest.approx([0, 0, bending, bending], rel=0.01, abs=0.01 * bending)


def test_round_film_under_tension(comm):
    """f = j_mn/(2πa) √(N0/ρt) for a = 1 m; a quarter has the modes of even m: j01, j21, j02."""
    frequencies = [mode.frequency for mode in modes(rest_of(comm, "circle", 2, 8), 3)]
    assert frequencies == pytest.approx(vibration.EXACT["circle"], rel=1e-3)


AXIS = (0.0, 0.0, SPIN)
# For 0, 1, 1, 2, 2, 3, 3 nodal diameters.
DISC = vibration.EXACT["hub"]


@pytest.mark.parametrize(
    ("given", "exact"),
    [
        ({}, DISC),
        ({"spin": AXIS}, DISC),
        # Those with two nodal diameters, without those below.
        ({"spin": AXIS, "above": 1.5 * SPIN / (2 * np.pi)}, DISC[3:5]),
    ],
    ids=["without Coriolis", "with Coriolis", "near a frequency"],
)
def test_disc_that_spins_about_a_hub(comm, given, exact):
    """Frequencies in the disc's frame, b/a = 0.2.

    Transverse vibrations feel no Coriolis force; the equation that has it must give the same.
    """
    found = modes(rest_of(comm, "hub", 2, 6), len(exact), **given)
    assert [mode.frequency for mode in found] == pytest.approx(exact, rel=1e-3)


def test_disc_that_spins_freely(comm):
    """(ω/Ω)² = [(n+2s)(n+2s+2)(3+ν) - n²(1+3ν)]/8: a quarter has n = 0, 2, 4 with s = 0, and n = 0
    with s = 1."""
    equilibrium = Equilibrium(vibration.film_of(comm, "free disc", 2, 8))
    found = equilibrium.find()
    assert found.free == ("translation z",)
    x = equilibrium.system.unknowns.q0.array_r.reshape(-1, 3)
    rim = comm.allreduce(float(np.hypot(x[:, 0], x[:, 1]).max()), max)
    expected = (1 - NU) / 4 * 5e-5
    assert rim - 1 == pytest.approx(expected, rel=1e-2)  # u(a)
    squares = [
        (2 * np.pi * mode.frequency / SPIN) ** 2 for mode in modes(equilibrium, 4, above=0.1)
    ]
    assert squares == pytest.approx([0.0, 2.35, 3.3, 6.1], abs=1e-2)


def test_coriolis_force_turns_the_plane_of_a_pendulum(comm):
    """A mass on equal springs, seen from axes that turn: ω = ω0 ± Ω, and ω0 along the axis.

    Without its centrifugal force it is refused, as with that of another spin.
    """
    mass = 2.0
    k = 50.0
    Ω = 3.0
    point = gx.PointMass(mass, (0.0, 0.0, 0.0), comm=comm)
    axes = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    springs = [
        gx.connectors.AxialSpring(point.port(), k, direction=axis, name=f"spring {axis}")
        for axis in axes
    ]
    spin = (0.0, 0.0, Ω)
    equilibrium = at_rest(point, *springs, Centrifugal(point, spin))
    ω0 = (k / mass) ** 0.5
    found = modes(equilibrium, 3, spin=spin)
    measured = [2 * np.pi * mode.frequency for mode in found]
    assert measured == pytest.approx([ω0 - Ω, ω0, ω0 + Ω], rel=1e-8)
    with pytest.raises(gx.InputError, match=r"forces are \[\(0.0, 0.0, 3.0\)\]"):
        modes(equilibrium, 3, spin=(0.0, Ω, 0.0))
    with pytest.raises(gx.InputError, match="forces are none"):
        modes(at_rest(point, *springs), 3, spin=spin)


def test_coriolis_matrix_of_a_film(comm):
    """2 M ω×: force 2 m Ω against x of a velocity along y, and skew."""
    film = gx.Membrane(sheet(comm, 3, 3), TENSIONED)
    system = gx.Scene(film).compile()
    G = system.matrices.gyroscopic((0.0, 0.0, SPIN))
    x, y, out = (system.unknowns.numbering.vector() for _ in range(3))
    x.array[0::3] = 1
    y.array[1::3] = 1
    G.mult(y, out)
    assert x.dot(out) == pytest.approx(-2 * 0.028 * SPIN)
    G.mult(x, out)
    assert y.dot(out) == pytest.approx(2 * 0.028 * SPIN)


def test_a_mass_on_a_gas_spring(comm):
    """ω² = γ p A²/(m V) of a piston with gas, and the frequencies of springs across are those
    without gas."""
    mass = 2.0
    area = 0.01
    volume = 2e-3
    pressure = 1e5
    k = 50.0
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
        gx.connectors.AxialSpring(piston.port(), k, direction=axis, name=f"spring {axis}")
        for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    ]
    equilibrium = at_rest(piston, gas, *across)
    found = modes(equilibrium, 3)
    exact = [
        (k / mass) ** 0.5,
        (k / mass) ** 0.5,
        (1.4 * pressure * area**2 / mass / volume) ** 0.5,
    ]
    assert [2 * np.pi * mode.frequency for mode in found] == pytest.approx(exact, rel=1e-9)
    assert found[2].effective_mass == pytest.approx([0.0, 0.0, mass], abs=1e-9)
    spin = (0.0, 0.0, 1.0)
    turning = at_rest(piston, gas, *across, Centrifugal(piston, spin))
    with pytest.raises(gx.InputError, match="in a turning frame"):
        modes(turning, 1, spin=spin)


def test_a_drum_over_closed_air(comm):
    """Modes that change the volume are stiffer by the gas; those of the others do not change."""
    bag = airbag(comm, 1.0, 8)
    frequencies = {}
    for closed in (False, True):
        film = gx.Membrane(bag, TENSIONED, order=2, initial_stress=N0 / THICKNESS)
        items = [film, gx.Fixed(film, "seam"), gx.Fixed(film, "bottom")]
        if closed:
            items.append(
                gx.Chamber(
                    film,
                    gas=gx.IdealGas(1.4, 287.0),
                    pressure=1e3,
                    temperature=300.0,
                    dead_volume=0.5,
                    outside=gx.gas.Ambient(1e3),
                )
            )
        equilibrium = at_rest(*items)
        frequencies[closed] = [mode.frequency for mode in modes(equilibrium, 4)]
    drum = frequencies[False]
    with_gas = frequencies[True]
    # The gas adds κ g⊗g: 1 + κ Σ (g·φ)²/(ω_mn² - ω²) = 0 over the modes of odd m and n, whose g·φ
    # is 8/(π² m n √(ρt)) with unit modal mass.
    κ = 1.4 * 1e3 / 0.5
    m, n = np.meshgrid(np.arange(1, 40, 2), np.arange(1, 40, 2))
    squares = np.pi**2 * N0 / 0.028 * (m**2 + n**2)
    volumes = 8 / (np.pi**2 * m * n) / 0.028**0.5
    ω = brentq(
        lambda ω: 1 + κ * np.sum(volumes**2 / (squares - ω**2)),
        1.001 * squares[0, 0] ** 0.5,
        0.999 * squares[0, 1] ** 0.5,
    )
    # The modes (1, 2), (2, 1) and (2, 2) do not change the volume.
    exact = sorted([*drum[1:4], ω / 2 / np.pi])
    assert with_gas == pytest.approx(exact, rel=2e-3)


@pytest.mark.mpi
def test_effective_masses(comm):
    """The mode (1, 1) of a square drum moves 64/π⁴ of its mass; without supports all is in rigid
    motions."""
    film = gx.Membrane(
        sheet(comm, 8, 8),
        TENSIONED,
        order=2,
        initial_stress=N0 / THICKNESS,
        name="drum",
    )
    equilibrium = at_rest(film, *(gx.Fixed(film, edge) for edge in EDGES))
    first = modes(equilibrium, 1)[0]
    assert first.effective_mass == pytest.approx([0, 0, 64 / np.pi**4 * 0.028], rel=1e-3, abs=1e-9)
    φ = first.displacements["drum"]
    assert φ.shape == (film.block.index_map.size_local, 3)
    largest = comm.allreduce(float(φ.real.max(initial=0.0)), MPI.MAX)
    # φ = 2/√(ρt) sin(πx) sin(πy) with unit modal mass
    assert largest == pytest.approx(2 / 0.028**0.5, rel=1e-3)


@pytest.mark.mpi
def test_effective_inertia_is_about_the_centre_of_all_mass(comm):
    """The mode (1, 1) turns a drum from 0 to 1 m about no axis through its centre, where no node
    may move along x or y, either."""
    film = gx.Membrane(sheet(comm, 4, 4), TENSIONED, initial_stress=N0 / THICKNESS)
    supports = [gx.Fixed(film, edge) for edge in EDGES]
    supports.append(gx.Fixed(film, "film", components=(0, 1)))
    first = modes(at_rest(film, *supports), 1)[0]
    assert first.effective_mass[2] > 0.01
    assert first.effective_inertia == pytest.approx([0, 0, 0], abs=1e-9)


def test_slack_film_has_no_frequencies_that_can_be_trusted(comm, caplog):
    film = gx.Membrane(sheet(comm, 3, 3), TENSIONED, displacement=lambda X: -1e-3 * X)
    equilibrium = Equilibrium(gx.Scene(film, gx.Fixed(film, "left")))
    found = equilibrium.find()
    assert not found.regular
    caplog.clear()
    modes(equilibrium, 2)
    assert "2 of 2 frequencies are zero within round-off" in caplog.text


@pytest.mark.mpi
def test_zero_frequencies_name_the_part_that_moves(comm, caplog):
    """A mast on a ball that a clamped one holds by a rope turns about its axis."""
    section = gx.sections.tube(0.02, 1e-3, E=70e9, nu=0.3, density=2700.0)
    post = gx.Beam(line(comm, [(0, 0, 0), (0, 0, 2)], 2), section, name="post")
    mast = gx.Beam(line(comm, [(2, 0, 0), (2, 0, 2)], 2), section, name="mast")
    ball = gx.constraints.BallJoint(mast.port("start"), gx.Ground((2, 0, 0)))
    ends = {"rope": post.port("end"), "left guy": gx.Ground((3, 1, 0))}
    ends["right guy"] = gx.Ground((3, -1, 0))
    ropes = [
        gx.connectors.Rope(mast.port("end"), b, stiffness=1e4, initial_tension=50.0, name=name)
        for name, b in ends.items()
    ]
    equilibrium = at_rest(gx.Fixed(post, "start", rotation=True), ball, *ropes)
    caplog.clear()
    modes(equilibrium, 1)
    if comm.rank == 0:
        assert "as 'mast' has no stiffness against them" in caplog.text


def test_film_in_contact(comm):
    """A sheet that lies on the ground vibrates across it by the stiffness of contact alone."""
    law = gx.Linear(E, NU, density=1400.0, thickness=THICKNESS)
    film = gx.Membrane(sheet(comm, 3, 3), law, initial_stress=N0 / THICKNESS)
    items = [film, gx.Gravity(film), *(gx.Fixed(film, edge, components=(0, 1)) for edge in EDGES)]
    floor = gx.contact.Plane(point=(0.0, 0.0, -2e-3), normal=(0.0, 0.0, 1.0))
    equilibrium = Equilibrium(gx.Scene(*items, gx.Contact(film, floor, distance=1e-3)))
    assert equilibrium.find().free == ()
    lowest = modes(equilibrium, 1)[0]
    assert lowest.frequency > 1.0
    assert lowest.effective_mass[2] == pytest.approx(1400 * THICKNESS, rel=0.05)


@pytest.mark.parametrize(
    ("tip", "exact"), [(0.0, (1.20241278, 2.76003906)), (0.5, (1.08666161, 3.41989511))]
)
def test_hanging_cable_with_a_mass_on_a_joint(comm, tip, exact):
    """ω√(L/g), twice each, of a cable of 1 m and 1 kg found in equilibrium under its weight."""
    down = (0.0, 0.0, -1.0)
    cable = gx.Cable(line(comm, [(0, 0, 0), down], 32), gx.CableLaw(1e5, 1.0), order=2)
    items = [gx.Fixed(cable, "start"), gx.Gravity(cable, down)]
    if tip:
        mass = gx.PointMass(tip, down, comm=comm)
        items += [gx.constraints.BallJoint(cable.port("end"), mass.port()), gx.Gravity(mass, down)]
    equilibrium = Equilibrium(gx.Scene(cable, *items))
    assert equilibrium.find().regular
    ω = [2 * np.pi * mode.frequency for mode in modes(equilibrium, 4)]
    assert ω == pytest.approx(np.repeat(exact, 2), rel=1e-4)


def test_cantilever(comm):
    """βL of a beam, whose sections stay rigid by multipliers, in both of its planes."""
    section = gx.sections.solid_circle(1e-2, E=1e9, nu=0.3, density=1000.0)
    beam = gx.Beam(line(comm, [(0, 0, 0), (1, 0, 0)], 8), section)
    equilibrium = at_rest(beam, gx.Fixed(beam, "start", rotation=True))
    scale = (section.line_density / section.EI2) ** 0.5
    βL = [(2 * np.pi * mode.frequency * scale) ** 0.5 for mode in modes(equilibrium, 4)]
    assert βL == pytest.approx(np.repeat((1.87510407, 4.69409113), 2), rel=1e-3)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("above", [0.0, 1.01, 2.4])
def test_a_free_hub_with_tethers_in_a_turning_frame(comm, above):
    """ω/Ω = √(R/L) in the plane, √(1 + R/L) out of it, of tethers L with tip masses that swing
    against each other.

    The hub of radius R is free: at zero frequency the stiffness is singular.
    """
    Ω = 3.0
    R = 0.2
    L = 1.0
    m = 0.05
    k = 1e5
    hub = gx.RigidBody(2.0, (0.3, 0.3, 0.5), comm=comm, name="hub")
    spin = (0.0, 0.0, Ω)
    items = [Centrifugal(hub, spin)]
    for i, e in enumerate(np.array([(1.0, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)])):
        tip = gx.PointMass(m, tuple((R + L) * e), comm=comm, name=f"tip {i}")
        length = L - m * Ω**2 * (R + L) / k
        items += [
            gx.connectors.Rope(
                hub.port(tuple(R * e)),
                tip.port(),
                length=length,
                stiffness=k,
                name=f"tether {i}",
            ),
            Centrifugal(tip, spin),
        ]
    equilibrium = Equilibrium(gx.Scene(*items))
    result = equilibrium.find()
    assert result.free == ("translation z", "rotation z")
    planar = np.sqrt(R / L)
    across = np.sqrt(1 + R / L)
    near = modes(equilibrium, 2 if above else 12, spin=spin, above=above * planar * Ω / (2 * np.pi))
    found = np.array([2 * np.pi * mode.frequency / Ω for mode in near])
    for exact in [planar, across] if above == 0 else [planar] if above < 2 else [across]:
        assert abs(found - exact).min() < 1e-5 * exact
    if above > 2:
        assert found.min() > planar


def test_a_film_on_a_free_hub_in_a_turning_frame(comm):
    """A rigid hub, much heavier than its film, is as good as held: the disc's own frequencies, hub
    free."""
    film = gx.Membrane(ring(comm, 0.2, 1.0, 4, 24, 2), SPUN, order=2)
    mass = 1e4 * 5e-5 * 1e9 / SPIN**2 * 1e-4 * np.pi
    hub = gx.RigidBody(mass, (mass, mass, 2 * mass), comm=comm, name="hub")
    spin = (0.0, 0.0, SPIN)
    scene = gx.Scene(
        gx.RigidRegion(film, "hub", rigid_body=hub), Centrifugal(film, spin), Centrifugal(hub, spin)
    )
    equilibrium = Equilibrium(scene)
    equilibrium.find()
    lowest = modes(equilibrium, 14, spin=spin)
    near = modes(equilibrium, 10, spin=spin, above=1.2 * SPIN / (2 * np.pi))
    squares = np.array([(2 * np.pi * mode.frequency / SPIN) ** 2 for mode in lowest])
    for exact in (0.733432, 1.158668):
        assert abs(squares / exact - 1).min() < 1e-3
    squares = np.array([(2 * np.pi * mode.frequency / SPIN) ** 2 for mode in near])
    for exact in (
        0.733432,
        1.0,
        1.158668,
        2.276136,
    ):  # of Ω the motion of the whole, as it is seen from turning axes
        assert abs(squares / exact - 1).min() < 1e-3


def test_an_unstable_equilibrium_is_reported(caplog):
    """A mass between two compressed springs escapes sideways at √(2 T/(l m))."""
    mass = gx.PointMass(0.5, (0.0, 0.0, 0.0), name="mass")
    springs = [
        gx.connectors.Spring(
            mass.port(), gx.Ground((x, 0.0, 0.0)), stiffness=100.0, length=1.1, name=f"spring {x}"
        )
        for x in (-1.0, 1.0)
    ]
    equilibrium = at_rest(mass, *springs)
    caplog.clear()
    found = modes(equilibrium, 3)
    assert [mode.growth for mode in found[:2]] == pytest.approx([40.0**0.5] * 2, rel=1e-9)
    assert found[2].frequency == pytest.approx(400.0**0.5 / (2 * np.pi), rel=1e-9)
    assert "not stable: 2 of 3 modes grow, the fastest by 6.32/s" in caplog.text
    assert "grows by 6.325/s" in repr(found[0])
    assert "grows" not in repr(found[2])


def test_a_buckled_boom_is_named(comm, caplog):
    """Between hinges under 1.5 times Euler's load: growth √(N/N_cr - 1) (π/L)² √(EI/μ)."""
    length = 2.0
    section = gx.sections.tube(0.02, 5e-4, E=100e9, nu=0.3, density=1560.0)
    euler = np.pi**2 * section.EI2 / length**2
    boom = gx.Beam(
        line(comm, [(0, 0, 0), (length, 0, 0)], 12),
        section,
        initial_tension=-1.5 * euler,
        name="boom",
    )
    ends = [gx.Fixed(boom, "start"), gx.Fixed(boom, "end")]
    equilibrium = at_rest(boom, *ends)
    caplog.clear()
    found = modes(equilibrium, 3)
    growth = (np.pi / length) ** 2 * np.sqrt(0.5 * section.EI2 / section.line_density)
    assert max(mode.growth for mode in found) == pytest.approx(growth, rel=0.02)
    assert "moves 'boom' most" in caplog.text or comm.rank > 0


@pytest.mark.mpi
def test_the_share_of_a_film_that_is_not_taut_is_that_of_its_states(comm):
    """A square whose left half is compressed along x and whose right half is stretched."""
    film = gx.Membrane(
        sheet(comm, 8, 2),
        TENSIONED,
        displacement=lambda X: STRETCH * np.vstack([abs(X[0] - 0.5), 3 * X[1], 0 * X[0]]),
    )
    equilibrium = Equilibrium(gx.Scene(film))
    _, _, taut = AreaFractions([film])(equilibrium.system)
    assert taut == pytest.approx(0.5, abs=0.01)


def test_effective_masses_of_free_motions_add_up_to_the_mass(comm):
    """Six rigid motions have the frequency zero: any combinations of them are modes, and their
    effective masses add up only if these are orthogonal."""
    section = gx.sections.tube(0.02, 5e-4, E=100e9, nu=0.3, density=1560.0)
    free = gx.Beam(line(comm, [(0, 0, 0), (2.0, 0.5, 0)], 6), section, name="free")
    equilibrium = at_rest(free)
    found = modes(equilibrium, 8)
    mass = section.line_density * np.hypot(2.0, 0.5)
    total = sum(mode.effective_mass for mode in found[:6])
    assert total == pytest.approx([mass] * 3, rel=1e-6)
    bending = found[6:]
    # Both bending modes have one frequency, and do not move the centre of mass.
    assert bending[0].frequency == pytest.approx(bending[1].frequency, rel=1e-6)
    assert max(abs(mode.effective_mass).max() for mode in bending) < 1e-6 * mass


def net_of_cables(comm) -> Equilibrium:
    """A square of 4 + 4 tensioned cables that are joined where they cross, of order 1."""
    cells = 5
    size = 0.2
    cables = {}
    for k in range(1, cells):
        along_x = [(i * size, k * size, 0.0) for i in range(cells + 1)]
        along_y = [(k * size, i * size, 0.0) for i in range(cells + 1)]
        for name, points in ((f"x{k}", along_x), (f"y{k}", along_y)):
            cables[name] = gx.Cable(
                line(comm, points, 1), gx.CableLaw(5e3, 0.02), initial_tension=40.0, name=name
            )
    inner = range(1, cells)
    joints = [
        gx.constraints.BallJoint(
            cables[f"x{k}"].port(f"point {i}"), cables[f"y{i}"].port(f"point {k}"), name=f"{i} {k}"
        )
        for i in inner
        for k in inner
    ]
    held = [gx.Fixed(cable, end) for cable in cables.values() for end in ("start", "end")]
    return Equilibrium(gx.Scene(*cables.values(), *joints, *held))


def frequencies_of_the_net() -> list[float]:
    """Closed form of the discrete net: ω² = (T/h)(4 - 2c_i - 2c_k)/(μh (4/3 + (c_i + c_k)/3))."""
    cosines = np.cos(np.arange(1, 5) * np.pi / 5)
    sums = np.add.outer(cosines, cosines).ravel()
    squares = 40.0 / 0.2 * (4 - 2 * sums) / (0.02 * 0.2 * (4 / 3 + sums / 3))
    return sorted(np.sqrt(squares) / (2 * np.pi))


@pytest.mark.mpi(1)
@pytest.mark.parametrize("count", [1, 6, 9, 10, 12, 16])
def test_no_copy_of_a_multiple_frequency_is_left_out(comm, count, caplog):
    """The seventh to tenth frequency of the net are one, 61.64 Hz."""
    equilibrium = net_of_cables(comm)
    equilibrium.find()
    found = modes(equilibrium, count)
    assert [mode.frequency for mode in found] == pytest.approx(
        frequencies_of_the_net()[:count], rel=1e-6
    )
    is_cut = "modes are cut from a group of 4 of one frequency; ask for 10" in caplog.text
    assert is_cut == (count == 9 and comm.rank == 0)


@pytest.mark.parametrize("shape", ["square", "ring"])
def test_pairs_of_symmetric_films_are_whole(comm, shape):
    """Of a square's modes (m, n) and (n, m), and of a ring's sine and cosine, none is left out."""
    mesh = sheet(comm, 8, 8, 2.1, 2.1, crossed=True)
    edges = EDGES
    if shape == "ring":
        mesh = ring(comm, 0.2, 1.0, 4, 24)
        edges = ("hub", "rim")
    film = gx.Membrane(mesh, TENSIONED, displacement=lambda X: STRETCH * X)
    equilibrium = at_rest(film, *(gx.Fixed(film, edge) for edge in edges))
    many = [mode.frequency for mode in modes(equilibrium, 20)]
    pairs = sum(b / a - 1 < 1e-6 for a, b in pairwise(many))
    assert pairs >= 5
    for count in range(1, 13):
        found = [mode.frequency for mode in modes(equilibrium, count)]
        assert found == pytest.approx(many[:count], rel=1e-6)
