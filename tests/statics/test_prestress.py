"""Films, cables and beams with initial stress or strain: statics, frequencies and runs with known
answers."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.analysis import modes
from gossamer_fx.meshes.disc import quarter_disc
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import EDGES, sheet
from tests.small_scenes import at_rest, momentum_changes, run_until, thrown

E = 2.3e9
NU = 0.3
THICKNESS = 2e-5
DENSITY = 1400.0
TENSION = 10.0  # N/m
STRESS = TENSION / THICKNESS
MASS = DENSITY * THICKNESS  # kg/m²

FILM = gx.Miyazaki(E, NU, density=DENSITY, thickness=THICKNESS)
ROPE = gx.TensionOnly(1e4, 0.01)


def held(film: gx.Membrane, *others: object, edges=EDGES) -> gx.Equilibrium:
    return gx.Equilibrium(gx.Scene(film, *others, *(gx.Fixed(film, edge) for edge in edges)))


def largest_displacement(equilibrium: gx.Equilibrium) -> float:
    moved = np.abs(equilibrium.system.unknowns.q0.array_r - start_of(equilibrium))
    return equilibrium.comm.allreduce(float(moved.max(initial=0.0)), MPI.MAX)


def start_of(equilibrium: gx.Equilibrium) -> np.ndarray:
    found = equilibrium.system.unknowns.numbering.vector().array
    for body in equilibrium.system.unknowns.bodies:
        found[equilibrium.system.unknowns.block(body).owned] = body.initial_state()[0]
    return found


# ---- films ---------------------------------------------------------------------------------------


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    ("order", "cells", "tolerance"),
    [(1, 16, 0.02), (2, 8, 2e-3)],
    ids=["P1", "P2"],
)
def test_square_drum(comm, order, cells, tolerance):
    """f = ½√(N/ρt) √((m/a)² + (n/a)²), and the mesh is in equilibrium."""
    a = 2.1
    film = gx.Membrane(sheet(comm, cells, cells, a, a), FILM, order=order, initial_stress=STRESS)
    equilibrium = held(film)
    equilibrium.find()
    # The mesh as drawn is the equilibrium.
    assert largest_displacement(equilibrium) < 1e-9
    wave_speed = (TENSION / MASS) ** 0.5
    exact = [
        wave_speed / 2 / a * (m * m + n * n) ** 0.5 for m, n in ((1, 1), (1, 2), (2, 1), (2, 2))
    ]
    # The error of frequencies: (h/λ)² for order 1.
    assert [mode.frequency for mode in modes(equilibrium, 4)] == pytest.approx(exact, rel=tolerance)


def test_round_drum(comm):
    """f = j_mn/(2πa) √(N/ρt); a quarter has the modes of even m: j01, j21, j02."""
    film = gx.Membrane(quarter_disc(comm, 8, 1.0, 2), FILM, order=2, initial_stress=STRESS)
    equilibrium = at_rest(
        film,
        gx.Fixed(film, "rim"),
        gx.Fixed(film, "x axis", components=(1,)),
        gx.Fixed(film, "y axis", components=(0,)),
    )
    # Zeros of Bessel functions.
    roots = np.array([2.404826, 5.135622, 5.520078])
    exact = roots / (2 * np.pi) * (TENSION / MASS) ** 0.5
    assert [mode.frequency for mode in modes(equilibrium, 3)] == pytest.approx(exact, rel=1e-3)


AXIS = (1.0, 2.0, 0.0)
FABRIC = {"E1": 2e9, "E2": 5e8, "nu12": 0.3, "G12": 3e8, "density": DENSITY, "thickness": THICKNESS}


@pytest.mark.parametrize(
    "law",
    [
        FILM,
        gx.Linear(E, NU, density=DENSITY, thickness=THICKNESS),
        gx.TensionField(E, NU, density=DENSITY, thickness=THICKNESS),
        gx.LinearOrthotropic(**FABRIC, direction=AXIS),
        gx.Orthotropic(**FABRIC, direction=AXIS),
    ],
    ids=lambda law: type(law).__name__,
)
def test_a_film_has_the_stress_that_was_given(comm, law):
    """Principal stresses of a tensor that is oblique to the axes of law and mesh."""
    # A rotation by the angle whose cosine is 0.8.
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    stress = turn @ np.diag([3e5, 1e5, 0.0]) @ turn.T
    film = gx.Membrane(sheet(comm, 3, 3), law, initial_stress=stress)
    equilibrium = held(film)
    equilibrium.find()
    for field, exact in (("stress1", 3e5), ("stress2", 1e5)):
        _, values = gx.fields.field_values(equilibrium, film, field=field)
        # Uniform stress: exact.
        assert values == pytest.approx(exact, rel=1e-9)


@pytest.mark.mpi
def test_a_strain_and_a_field_of_stress(comm):
    """σ = E/(1-ν) e of an equal strain e; a function of the points and a number give the same
    film."""
    strain = STRESS * (1 - NU) / E
    by_strain = held(gx.Membrane(sheet(comm, 3, 3), FILM, initial_strain=strain))
    by_field = held(
        gx.Membrane(sheet(comm, 3, 3), FILM, initial_stress=lambda X: STRESS * np.ones_like(X[0]))
    )
    energies = []
    for equilibrium in (by_strain, by_field):
        equilibrium.find()
        energies.append(equilibrium.totals.stored["film"])
    exact = THICKNESS * STRESS * strain  # ½ t (σ:e), with σ and e the same in both directions
    assert energies == pytest.approx([exact, exact], rel=1e-12)


def test_stress_by_group_and_other_cells_without_stress(comm):
    film = gx.Membrane(sheet(comm, 3, 3), FILM, initial_stress={"film": STRESS})
    equilibrium = held(film)
    equilibrium.find()
    _, values = gx.fields.field_values(equilibrium, film, field="stress2")
    assert values == pytest.approx(STRESS, rel=1e-9)


def test_film_that_is_let_free_shrinks_by_its_initial_strain(comm):
    """Without supports the film takes its natural size: λ² = 1 - 2 e."""
    e = 0.02
    film = gx.Membrane(sheet(comm, 3, 3), FILM, initial_strain=e)
    supports = [
        gx.Fixed(film, "left", components=(0,)),
        gx.Fixed(film, "bottom", components=(1,)),
        gx.Fixed(film, "bottom left"),
        gx.Fixed(film, "bottom right", components=(2,)),
        gx.Fixed(film, "top left", components=(2,)),
    ]
    equilibrium = at_rest(film, *supports)
    corner = gx.probes.Position(film.port("top right"), "x")(equilibrium)
    # Natural size: Green's strain -e.
    assert corner == pytest.approx((1 - 2 * e) ** 0.5, rel=1e-7)


@pytest.mark.parametrize("order", [1, 2])
def test_a_prestressed_film_that_flies_conserves_energy_and_momenta(comm, order):
    """The film contracts, flutters and spins; nothing acts on it."""
    film = gx.Membrane(
        sheet(comm, 4, 4),
        FILM,
        order=order,
        initial_stress=100 * STRESS,
        velocity=thrown,
    )
    run = run_until(0.02, film, dt=1e-3, tolerances=gx.Tolerances(relative=1e-12))
    # The stored energy drives the motion.
    assert run.first.stored["film"] > 10 * run.first.kinetic
    assert run.totals.kinetic > 2 * run.first.kinetic
    assert abs(run.energy_error) <= 1e-11
    size = (2 * MASS * run.totals.kinetic) ** 0.5
    assert max(momentum_changes(run)) <= 1e-11 * size


# ---- cables --------------------------------------------------------------------------------------


def test_string(comm):
    """f = n/(2L) √(N/μ)."""
    cable = gx.Cable(line(comm, [(0, 0, 0), (2.0, 0, 0)], 16), ROPE, order=2, initial_tension=50.0)
    equilibrium = at_rest(cable, gx.Fixed(cable, "start"), gx.Fixed(cable, "end"))
    # n/2L with L = 2 m, each twice for the two directions.
    exact = np.repeat([1.0, 2.0, 3.0], 2) / 4 * (50.0 / ROPE.line_density) ** 0.5
    assert [mode.frequency for mode in modes(equilibrium, 6)] == pytest.approx(exact, rel=2e-4)


@pytest.mark.parametrize("factor", [0.98, 0.9], ids=str)
def test_a_cable_that_is_cut_short(comm, factor):
    """Its tension is that of the law at the stretch 1/factor, and its mass that of the natural
    length."""
    cable = gx.Cable(line(comm, [(0, 0, 0), (2.0, 0, 0)], 4), ROPE, length_factor=factor)
    start, end = gx.Fixed(cable, "start"), gx.Fixed(cable, "end")
    equilibrium = at_rest(cable, start, end)
    stretch = 1 / factor
    tension = ROPE.EA * (stretch**2 - 1) / 2 * stretch
    force, _ = equilibrium.reaction(end)
    # Uniform along the cable.
    assert force == pytest.approx([tension, 0.0, 0.0], abs=1e-6 * tension)
    # A step whose strains do not change has nothing to correct the mean stress of its path by.
    run = run_until(2e-3, cable, start, end, dt=1e-3)
    assert gx.probes.Tension(cable)(run) == pytest.approx(tension, rel=1e-9)
    hanging = gx.Cable(line(comm, [(0, 0, 0), (0, 0, 2.0)], 4), ROPE, length_factor=factor)
    top = gx.Fixed(hanging, "end")
    weighed = at_rest(hanging, top, gx.Gravity(hanging, (0.0, 0.0, -10.0)))
    # Mass of the natural length.
    weight = ROPE.line_density * 2.0 * factor * 10
    assert weighed.reaction(top)[0][2] == pytest.approx(weight, rel=1e-7)


def test_a_turnbuckle_tightens_a_cable(comm):
    """A tether whose length is a function of time pulls the cable's end: both have one tension."""
    cable = gx.Cable(line(comm, [(0, 0, 0), (2.0, 0, 0)], 4), ROPE)
    wall = gx.Ground((2.1, 0.0, 0.0))
    turnbuckle = gx.connectors.Tether(
        cable.port("end"),
        wall,
        stiffness=1e6,
        length=lambda t: 0.1 - t,
        name="turnbuckle",
    )
    start = gx.Fixed(cable, "start")
    across = gx.Fixed(cable, "line", components=(1, 2))
    equilibrium = gx.Equilibrium(gx.Scene(cable, turnbuckle, start, across))
    tensions = []
    for shortening in (0.01, 0.02):
        equilibrium.find(at=shortening)
        tensions.append(-equilibrium.reaction(start)[0][0])
    # N = EA ½(λ² - 1) λ of the cable equals k (shortening - elongation) of the turnbuckle.
    for shortening, tension in zip((0.01, 0.02), tensions, strict=True):
        # Length that is taken out less what the turnbuckle stretches.
        elongation = shortening - tension / 1e6
        λ = 1 + elongation / 2
        assert tension == pytest.approx(ROPE.EA * (λ**2 - 1) / 2 * λ, rel=1e-6)


# ---- beams ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [1.0, -0.5], ids=["tension", "compression"])
def test_beam_under_axial_force(comm, share):
    """ω² = (π/L)⁴ EI/μ (1 + N/P), P = π² EI/L² the Euler load, of a slender beam on two
    supports."""
    section = gx.sections.solid_circle(2e-3, E=70e9, nu=0.3, density=2700.0)
    L = 1.0
    euler_load = np.pi**2 * section.EI2 / L**2
    beam = gx.Beam(
        line(comm, [(0, 0, 0), (L, 0, 0)], 12),
        section,
        initial_tension=share * euler_load,
    )
    ends = [gx.Fixed(beam, "start"), gx.Fixed(beam, "end")]
    equilibrium = at_rest(beam, *ends)
    # Euler's column: frequency zero at N = -P.
    ω = (np.pi / L) ** 2 * (section.EI2 / section.line_density * (1 + share)) ** 0.5
    found = [mode.frequency for mode in modes(equilibrium, 2, above=0.9 * ω / 2 / np.pi)]
    # Rotary inertia and shear of a slender beam are below 1e-3.
    assert found == pytest.approx([ω / 2 / np.pi] * 2, rel=2e-3)


# ---- bad input -----------------------------------------------------------------------------------


def test_what_is_refused(comm):
    mesh = sheet(comm, 2, 2)
    with pytest.raises(gx.InputError, match="initial_strain and initial_stress are both given"):
        gx.Membrane(mesh, FILM, initial_stress=1e5, initial_strain=1e-3)
    with pytest.raises(gx.InputError, match=r"compressive \(-1e\+05 Pa\), but the film wrinkles"):
        gx.Membrane(mesh, FILM, initial_stress=-1e5)
    with pytest.raises(gx.InputError, match="give a symmetric tensor"):
        gx.Membrane(mesh, FILM, initial_stress=[[0, 1, 0], [0, 0, 0], [0, 0, 0]])
    with pytest.raises(gx.InputError, match="give a number"):
        gx.Membrane(mesh, FILM, initial_stress=[1.0, 2.0])
    elastica = gx.analysis.Prestress(E, NU, density=DENSITY, thickness=THICKNESS, tension=TENSION)
    with pytest.raises(gx.InputError, match="Prestress does not say which strain has it"):
        gx.Membrane(mesh, elastica, initial_stress=1e5)
    curve = line(comm, [(0, 0, 0), (1, 0, 0)], 2)
    with pytest.raises(gx.InputError, match="TabulatedCable does not say which strain has it"):
        table = gx.TabulatedCable([0.0, 0.1], [0.0, 10.0], line_density=0.01)
        gx.Cable(curve, table, initial_tension=1.0)
    with pytest.raises(gx.InputError, match="its initial_tension function: it returns"):
        gx.Cable(curve, ROPE, initial_tension=lambda X: np.nan * X[0])


# ---- asked for and reached -----------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2])
def test_a_fixed_film_keeps_its_prestress(comm, order, caplog):
    """With all edges fixed the mesh is in equilibrium, so that all of the stress is left."""
    film = gx.Membrane(sheet(comm, 4, 4), FILM, order=order, initial_stress=STRESS)
    reached = held(film).find().prestress["film"]
    assert reached.unit == "Pa"
    values = (reached.asked, reached.mean, reached.least, reached.largest)
    assert values == pytest.approx((STRESS,) * 4, rel=1e-9)
    assert reached.ratio == pytest.approx(1.0, rel=1e-9)
    assert "prestress" not in caplog.text


@pytest.mark.parametrize("stress", [0.0, np.zeros((3, 3)), {"film": 0.0}], ids=str)
def test_a_prestress_of_zero_is_none(comm, stress):
    film = gx.Membrane(sheet(comm, 2, 2), FILM, initial_stress=stress)
    assert held(film, gx.Pressure(film, 10.0)).find().prestress == {}


def test_springs_in_series_take_prestress_back(comm, caplog):
    """A cable of EA/L = k between a support and a spring K keeps K/(k + K) of its tension.

    The spring is at rest in the shape of the mesh, where the cable has the tension N0; the strain
    is small, so that the cable is linear.
    """
    stiff = gx.CableLaw(1e6, 0.01)
    for spring_stiffness, share in ((2e6, 0.8), (5e5 / 3, 0.25)):
        caplog.clear()
        cable = gx.Cable(line(comm, [(0, 0, 0), (2, 0, 0)], 4), stiff, initial_tension=10.0)
        spring = gx.connectors.Spring(
            cable.port("end"),
            gx.Ground((3.0, 0, 0)),
            stiffness=spring_stiffness,
            length=1.0,
        )
        sideways = gx.Fixed(cable, "line", components=(1, 2))
        statics = gx.Equilibrium(gx.Scene(cable, spring, gx.Fixed(cable, "start"), sideways))
        result = statics.find()
        reached = result.prestress["cable"]
        assert reached.asked == pytest.approx(10.0, rel=1e-12)
        assert reached.ratio == pytest.approx(share, rel=1e-4)
        # The probe reads the same tension as the spring.
        assert gx.probes.Tension(cable)(statics) == pytest.approx(reached.mean, rel=1e-9)
        assert gx.probes.Tension(spring)(statics) == pytest.approx(reached.mean, rel=1e-6)
        words = f"'cable' has {reached.mean:.3g} N of 10 N ({100 * share:.3g} %)"
        if comm.rank == 0:
            assert words in caplog.text
            assert f"prestress of 'cable' {reached.mean:.3g} N of 10 N" in repr(result)


def test_heat_that_takes_prestress_is_named(comm, caplog):
    """Between fixed edges a film that is warmer by ΔT loses the stress E α ΔT/(1 - ν)."""
    warm = gx.materials.ThermalExpansion(2e-5, 303.15, reference=293.15)
    film = gx.Membrane(sheet(comm, 2, 2), FILM, initial_stress=2 * STRESS, thermal=warm)
    reached = held(film).find().prestress["film"]
    expected = 2 * STRESS - E * 2e-5 * 10.0 / (1 - NU)
    assert reached.mean == pytest.approx(expected, rel=1e-3)
    if comm.rank == 0:
        assert "supports give way, or loads or heat relieve it: 'film' has" in caplog.text


def test_film_on_soft_springs(comm, caplog):
    """A strip of film between a support and springs, stressed in one direction.

    The film has the stiffness k = E t b/L along the strip, in series with springs of K = k in all:
    half of the stress is left.  Springs at the nodes have the widths of these as weights, so that
    the stress is uniform.
    """
    length = 2.0
    width = 0.5
    stiffness = E * THICKNESS * width / length
    strip = gx.Membrane(
        sheet(comm, 4, 2, length, width),
        gx.Linear(E, 0.0, density=DENSITY, thickness=THICKNESS),
        initial_stress=np.diag([STRESS, 0.0, 0.0]),
    )
    springs = [
        gx.connectors.AxialSpring(
            strip.port_at((length, y, 0.0)),
            weight * stiffness,
            direction=(1.0, 0.0, 0.0),
            origin=(length, 0.0, 0.0),
            name=f"spring {y}",
        )
        for y, weight in ((0.0, 0.25), (width / 2, 0.5), (width, 0.25))
    ]
    supports = [
        gx.Fixed(strip, "left", components=(0,)),
        gx.Fixed(strip, "film", components=(1, 2)),
    ]
    result = gx.Equilibrium(gx.Scene(strip, *springs, *supports)).find()
    reached = result.prestress["film"]
    assert reached.asked == pytest.approx(STRESS, rel=1e-12)
    # Linear up to the strain, 2e-4.
    assert (reached.least, reached.largest) == pytest.approx((STRESS / 2,) * 2, rel=1e-3)
    if comm.rank == 0:
        assert "'film' has 250 kPa of 500 kPa (50 %); support it more stiffly" in caplog.text


@pytest.mark.mpi
def test_prestress_of_groups_and_beams(comm):
    """Only parts with an initial tension count; a compressed beam has a negative one."""
    mesh = line(comm, [(0, 0, 0), (1, 0, 0)], 10)
    half = gx.Cable(mesh, ROPE, initial_tension=lambda X: np.where(X[0] < 0.5, 20.0, 0.0))
    fixed = gx.Equilibrium(gx.Scene(half, gx.Fixed(half, "line"))).find()
    reached = fixed.prestress["cable"]
    assert (reached.asked, reached.mean) == pytest.approx((20.0, 20.0), rel=1e-12)
    section = gx.sections.tube(0.02, 5e-4, E=100e9, nu=0.3, density=1560.0)
    beam = gx.Beam(mesh, section, initial_tension=-30.0)
    clamps = [gx.Fixed(beam, end, rotation=True) for end in ("start", "end")]
    pressed = gx.Equilibrium(gx.Scene(beam, *clamps)).find()
    reached = pressed.prestress["beam"]
    assert (reached.asked, reached.mean) == pytest.approx((-30.0, -30.0), rel=1e-9)
    short = gx.Cable(mesh, ROPE, length_factor=0.98)
    taut = gx.Equilibrium(gx.Scene(short, gx.Fixed(short, "line"))).find()
    tension = 1e4 * ((1 / 0.98) ** 2 - 1) / 2 / 0.98
    assert taut.prestress["cable"].mean == pytest.approx(tension, rel=1e-12)
    # Without prestress nothing is compared.
    plain = gx.Cable(mesh, ROPE)
    assert not gx.Equilibrium(gx.Scene(plain, gx.Fixed(plain, "line"))).find().prestress
