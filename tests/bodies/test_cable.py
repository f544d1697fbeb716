"""Cables against closed forms.

Sources:
    spinning loop     balance of a polygon of bars with consistent mass; λ² = 1 + 2 μ Ω² R²/EA of
                      the circle
    elastic catenary  H. M. Irvine, Cable Structures (1981), chapter 2, with N = EA λ (λ² - 1)/2 for
    EA (λ - 1)
    hanging cable     ω √(L/g) = half the zeros of J0 (D. Bernoulli): G. N. Watson, A Treatise on
                      the Theory of Bessel Functions, 2nd ed. (1944), chapter 1; with a tip mass the
                      zeros of the corresponding combination of J0, J1, Y0 and Y1
    spinning cable    (T(x) w')' + μ ω² w = 0 with the tension T = μ Ω² (R² - x²)/2: Legendre's
                      equation, whose eigenvalues are (ω/Ω)² = n (2 n - 1) for a hub of radius zero;
                      for a hub of 0.2 L by quadrature
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from mpi4py import MPI
from spectrum import angular_frequencies

import gossamer_fx as gx
from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import run_until

COMM = MPI.COMM_WORLD


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    # λ of the formula in the docstring, by which the polygon stands still; it tends to the
    # circle's.
    ("corners", "stretch"),
    [(8, 1.017887399), (16, 1.019306166), (32, 1.019678284)],
)
def test_spinning_loop_keeps_its_radius(corners: int, stretch: float) -> None:
    """λ² = 1 + (2μΩ²R²/EA)(4 + 2 cos(2π/N))/6 of a polygon of bars with consistent mass."""
    angle = 2 * np.pi * np.arange(corners) / corners
    points = np.array([np.cos(angle), np.sin(angle), 0 * angle]).T
    loop = gx.Cable(
        line(COMM, points, 1, closed=True),
        gx.CableLaw(EA=200.0, line_density=0.01),
        displacement=lambda x: (stretch - 1) * x,
        velocity=lambda x: 20.0 * stretch * np.vstack([-x[1], x[0], 0 * x[2]]),
    )
    run = gx.Simulation(gx.Scene(loop), gx.Midpoint(dt=2e-3))
    for k in range(10):
        run.run(until=0.04 * (k + 1))
        radius = np.linalg.norm(run.system.unknowns.q0.array_r.reshape(-1, 3), axis=1)
        error = np.abs(radius / stretch - 1).max(initial=0.0)
        # The stretch is given with ten digits; 20 rad/s for 0.4 s amplify their round-off to below
        # 1e-6.
        assert error < 1e-6
    assert abs(run.energy_error) < 1e-11


def test_elastic_catenary() -> None:
    """Span 10 m, length 11 m, 5 N/m, EA = 1e4 N, St. Venant-Kirchhoff; accepted within 0.2 %."""

    def sagging(x: np.ndarray) -> np.ndarray:
        s = x[0] / 11
        # A parabola of about the final sag, from which Newton's method converges.
        return np.vstack([-x[0] / 11, 0 * s, -4 * 2.2 * s * (1 - s)])

    cable = gx.Cable(
        line(COMM, [(0, 0, 0), (11, 0, 0)], 40),
        gx.CableLaw(EA=1e4, line_density=0.5),
        order=2,
        displacement=sagging,
    )
    scene = gx.Scene(
        cable,
        gx.Fixed(cable, "start"),
        gx.Fixed(cable, "end"),
        gx.Gravity(cable, (0, 0, -10.0)),
    )
    found = Equilibrium(scene)
    found.find()
    x = found.system.unknowns.q0.array_r.reshape(-1, 3)
    sag = -x[:, 2].min()
    # Sag, horizontal force and end force of the elastic catenary, solved with its two equations.
    assert sag == pytest.approx(2.044323, rel=2e-3)
    reactions = found.system.unknowns.supports.reactions.reshape(2, 3)
    assert np.abs(reactions[:, 0]) == pytest.approx(32.037271, rel=2e-3)
    assert np.linalg.norm(reactions, axis=1) == pytest.approx(42.221283, rel=2e-3)
    # Half the weight, 11 m × 0.5 kg/m × 10 m/s² / 2, which equilibrium gives exactly.
    assert np.abs(reactions[:, 2]) == pytest.approx(27.5, rel=1e-8)


def hanging(tip_mass: float, elements: int = 64) -> gx.Scene:
    """Cable of 1 m and 1 kg along -z under g = 1 m/s², stretched as its weight and a tip mass
    stretch it."""
    EA = 1e5

    def stretched(x: np.ndarray) -> np.ndarray:
        # EA u' = g (weight below): the stretch is in equilibrium, so that only vibration is left.
        depth = -x[2]
        return np.vstack([0 * depth, 0 * depth, -(depth * (1 + tip_mass) - depth**2 / 2) / EA])

    cable = gx.Cable(
        line(COMM, [(0, 0, 0), (0, 0, -1)], elements),
        gx.CableLaw(EA, 1.0),
        order=2,
        displacement=stretched,
    )
    items: list = [gx.Fixed(cable, "start")]
    if tip_mass:
        mass = gx.PointMass(tip_mass, (0, 0, -1 - (tip_mass + 0.5) / EA))
        items.append(gx.constraints.BallJoint(cable.port("end"), mass.port()))
    return gx.Scene(cable, *items)


def test_hanging_cable_frequencies() -> None:
    """ω√(L/g) = half the zeros of J0."""
    ω = angular_frequencies(hanging(0.0), direction=0)
    # j0,n / 2 with the zeros 2.4048, 5.5201, 8.6537, 11.7915.
    assert ω[:4] == pytest.approx([1.20241278, 2.76003906, 4.32686396, 5.89576722], rel=1e-2)


def test_hanging_cable_with_tip_mass_frequencies() -> None:
    """A tip mass of half the cable's; every frequency twice, for both directions."""
    ω = angular_frequencies(hanging(0.5))
    # Zeros of the transcendental equation with J0, J1, Y0, Y1 for a tip mass of half the cable's
    # mass.
    assert ω[[0, 2, 4]] == pytest.approx([1.08666161, 3.41989511, 6.28032853], rel=1e-2)


@pytest.mark.parametrize(
    ("hub", "squares"),
    # n(2n - 1) for a hub of radius 0; eigenvalues of the same equation for a hub of 0.2 L.
    [(0.0, (1.0, 6.0, 15.0, 28.0)), (0.2, (1.29755588, 7.56342702, 18.83961821))],
)
def test_spinning_cable_frequencies(hub: float, squares: tuple[float, ...]) -> None:
    """(ω/Ω)² out of plane of a cable spinning about a hub of radius 0 or 0.2 L, Ω = 1 rad/s."""
    EA = 1e5
    L = 1.0

    def stretched(x: np.ndarray) -> np.ndarray:
        r = x[0]
        # EA u' = ∫_r^{hub+L} μ Ω² s ds
        end = hub + L
        u = (end**2 * (r - hub) / 2 - (r**3 - hub**3) / 6) / EA
        return np.vstack([u, 0 * u, 0 * u])

    cable = gx.Cable(
        line(COMM, [(hub, 0, 0), (hub + L, 0, 0)], 64),
        gx.CableLaw(EA, 1.0),
        order=2,
        displacement=stretched,
    )
    ω = angular_frequencies(gx.Scene(cable, gx.Fixed(cable, "start")), direction=2)
    assert ω[: len(squares)] ** 2 == pytest.approx(squares, rel=1e-2)


@pytest.mark.parametrize("strain", ["green", "engineering"])
def test_tension_only_cable_goes_slack(strain: Literal["green", "engineering"]) -> None:
    """Thrown together it carries nothing: the ends meet as if there were no cable, and energy is
    kept throughout."""
    cable = gx.Cable(
        line(COMM, [(0, 0, 0), (1, 0, 0)], 4),
        gx.TensionOnly(EA=100.0, line_density=1.0, strain=strain),
        velocity=lambda x: np.vstack([-(x[0] - 0.5), 0 * x[0], 0 * x[0]]),
    )
    run = run_until(0.8, cable, dt=1e-2)
    x = run.system.unknowns.q0.array_r.reshape(-1, 3)
    # 1 m - 1 m/s × 0.8 s: without force the ends approach at the initial speed.
    assert np.ptp(x[:, 0]) == pytest.approx(0.2, abs=1e-12)
    run.run(until=2.05)  # it has passed through itself and is taut again
    assert abs(run.energy_error) < 1e-10
    assert run.totals.stored["cable"] > 0


@pytest.mark.parametrize("law", [gx.CableLaw, gx.TensionOnly])
@pytest.mark.parametrize("order", [1, 2])
def test_a_cable_linear_in_the_stretch_is_longer_by_its_weight(
    law: type[gx.CableLaw], order: int
) -> None:
    """Hooke: m g L/EA, of the cable half its own weight, at 10 % strain; its derivative by EA;
    the tension that is read is the weight below."""
    EA = 300.0
    m = 2.0
    μ = 1.0
    cable = gx.Cable(
        line(COMM, [(0, 0, 0), (0, 0, -1)], 4), law(EA, μ, strain="engineering"), order=order
    )
    tip = gx.PointMass(m, (0.0, 0.0, -1.0))
    pull = (0.0, 0.0, -10.0)
    scene = gx.Scene(
        gx.Fixed(cable, "start"),
        gx.constraints.BallJoint(cable.port("end"), tip.port()),
        gx.Gravity(cable, pull),
        gx.Gravity(tip, pull),
    )
    search = Equilibrium(scene)
    search.find()
    elongation = 10 * (m + μ / 2) / EA
    height = gx.probes.Position(tip.port(), "z")
    assert height(search) == pytest.approx(-1 - elongation, abs=1e-9)
    (slope,) = gx.analysis.gradient(search, of=height, by=["cable.EA"])
    assert slope.values == pytest.approx(elongation / EA, rel=1e-7)
    tensions = gx.fields.line_values(search, cable).tension
    # The lowest element has half of its weight below its middle.
    assert tensions.min() >= 10 * m
    assert tensions.mean() == pytest.approx(10 * (m + μ / 2), rel=1e-8)


@pytest.mark.parametrize("law", [gx.CableLaw, gx.TensionOnly])
def test_a_thrown_cable_linear_in_the_stretch_conserves(law: type[gx.CableLaw]) -> None:
    """400 steps with strains between -30 and 30 %, from a prestressed straight line."""
    cable = gx.Cable(
        line(COMM, [(0, 0, 0), (1, 0, 0)], 6),
        law(100.0, 0.1, strain="engineering"),
        initial_tension=5.0,
        velocity=lambda X: np.vstack([6 * np.cos(9 * X[0]), 3 * X[0], 2 * np.sin(7 * X[0])]),
    )
    solved = gx.Tolerances(relative=1e-12)
    run = gx.Simulation(gx.Scene(cable), gx.Midpoint(dt=1e-3, tolerances=solved))
    assert run.totals.stored["cable"] == pytest.approx(100 / 2 * (5 / 95) ** 2)
    run.run(until=0.4)
    assert abs(run.energy_error) < 1e-12
    assert run.totals.momentum == pytest.approx(run.first.momentum, abs=1e-12)
    assert run.totals.angular_momentum == pytest.approx(run.first.angular_momentum, abs=1e-12)


def test_the_initial_tension_is_that_of_the_law() -> None:
    """In the shape of its mesh a cable has the tension that it was given."""
    cable = gx.Cable(
        line(COMM, [(0, 0, 0), (1, 0, 0)], 2),
        gx.CableLaw(100.0, 0.1, strain="engineering"),
        initial_tension=20.0,
    )
    run = gx.Simulation(gx.Scene(cable), gx.Midpoint(dt=1e-3))
    assert gx.fields.line_values(run, cable).tension == pytest.approx(20.0, rel=1e-12)


def test_tapes_are_linear_in_the_stretch_as_cables_are() -> None:
    """A strip of film between two tapes of each law has the same energy as with a table."""
    film = gx.Membrane(
        sheet(COMM, 2, 1, 1.0, 0.1),
        gx.Linear(E=1e6, nu=0.3, density=1000.0, thickness=1e-4),
        displacement=lambda X: np.vstack([0.2 * X[0] ** 2 - 0.1 * X[0], 0 * X[0], 0 * X[0]]),
    )
    pairs = [
        (
            gx.CableLaw(50.0, 0.1, strain="engineering"),
            gx.TabulatedCable([-0.5, 0.0, 0.5], [-25.0, 0.0, 25.0], line_density=0.1),
        ),
        (
            gx.TensionOnly(50.0, 0.1, strain="engineering"),
            gx.TabulatedCable([0.0, 0.5], [0.0, 25.0], line_density=0.1),
        ),
    ]
    for law, table in pairs:
        energies = []
        for of_tape in (law, table):
            tape = gx.connectors.Tape.along_edges(film, of_tape, edges="bottom")
            run = gx.Simulation(gx.Scene(tape), gx.Midpoint(dt=1e-4))
            energies.append(run.totals.stored["tape"])
        assert energies[0] > 0
        assert energies[0] == pytest.approx(energies[1], rel=1e-14)


def test_prestress_that_a_cable_cannot_have(comm):
    mesh = line(comm, [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], 4)
    with pytest.raises(gx.InputError, match="initial_tension is -5 N"):
        gx.Cable(mesh, gx.TensionOnly(1e3, 0.01), initial_tension=-5.0)
    with pytest.raises(gx.InputError, match="length_factor and initial_tension are both given"):
        gx.Cable(mesh, gx.CableLaw(1e3, 0.01), initial_tension=5.0, length_factor=0.9)
    with pytest.raises(gx.InputError, match="1000 N at most"):
        gx.Cable(mesh, gx.CableLaw(1e3, 0.01, strain="engineering"), initial_tension=1e3)
